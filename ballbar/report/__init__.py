"""report.html: verdict, figures, tables, provenance of one run."""

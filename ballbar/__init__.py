"""The application: command line, scenarios, comparison, report and replay."""

PACKAGES = ("cell", "sim", "acquisition", "ident", "planning", "ballbar")  # of this project

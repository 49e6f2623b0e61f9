"""What the thesis says against what comes out here."""

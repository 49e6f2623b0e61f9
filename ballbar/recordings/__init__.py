"""Recording folders: checked, made from two files."""

"""Recording folders: made from two log files, and checked."""

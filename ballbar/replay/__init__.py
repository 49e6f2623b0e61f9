"""A run to look at: one rerun file, its layouts, the viewer."""

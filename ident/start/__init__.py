"""Starting values from two logs, without a guess."""

"""Pages and pictures of the documentation that are made by a program."""

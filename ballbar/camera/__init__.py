"""From a printed board to a table of its corners in pictures."""

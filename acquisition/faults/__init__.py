"""What can be wrong with a logged row, one module a kind."""

"""Planning at the terminal."""

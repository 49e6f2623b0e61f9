"""Live recording at the terminal."""

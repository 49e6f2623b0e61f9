"""A simulated run against the truth that it was simulated from."""

"""Simulated recordings of a cell. Knows the truth; identification and acquisition do not import it."""

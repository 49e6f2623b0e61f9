"""Faults of logged rows, one module a kind."""

"""Loads of the gears and the tension of the rod."""

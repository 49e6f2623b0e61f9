"""Simulated recordings of a cell. Acquisition and identification do not import this package."""

"""Recordings to clean angles and loads, dwells, and a coarse alignment of the clocks."""

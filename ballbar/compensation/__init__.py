"""Targets corrected for the identified robot."""

"""Encoders, clocks and writers of device files."""

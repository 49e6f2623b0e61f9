"""One identified run: its data, calibration.yaml, comparison with a reference."""

"""Performance of a robot by the characteristics of ISO 9283 and ISO 230-4."""

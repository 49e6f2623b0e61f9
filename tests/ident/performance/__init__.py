"""Tests of the characteristics of ISO 9283 and ISO 230-4."""

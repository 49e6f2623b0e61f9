"""Corrected joint targets."""

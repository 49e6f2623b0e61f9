"""Angles on one clock to identified parameters, their uncertainty and a verdict."""

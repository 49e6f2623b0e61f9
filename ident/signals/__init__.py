"""A log as a smooth function of time."""

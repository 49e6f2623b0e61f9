"""Text of device files to columns of numbers."""

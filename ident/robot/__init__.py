"""The identified robot without its instrument: accuracy, unloaded pose, compensation."""

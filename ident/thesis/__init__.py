"""The cost functions of Brand & Nilsson 2016, the baseline of every comparison."""

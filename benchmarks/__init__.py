"""Studies and benchmarks: run by command, printing the figures that the docs quote."""

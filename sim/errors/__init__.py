"""Error sources of clocks, sensors and samples."""

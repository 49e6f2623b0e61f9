"""Error sources of geometry, plant, clocks, sensors and samples: their keys and their sizes."""

"""Makes recordings: plant, error sources, encoders, clocks, device files; and the truth beside them."""

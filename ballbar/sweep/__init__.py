"""A scenario many times: plan, parts, workers, one table."""

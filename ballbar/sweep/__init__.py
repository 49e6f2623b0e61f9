"""A scenario run many times: plan, chunks, workers, one table."""

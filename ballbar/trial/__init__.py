"""One run of a scenario, as a row of results."""

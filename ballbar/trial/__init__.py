"""One run of a sweep."""

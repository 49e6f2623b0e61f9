"""The order of time stamps, and stamps coarser than the rows."""

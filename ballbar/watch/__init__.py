"""`ballbar watch`: a recording identified while it is being written, by whatever writes it."""

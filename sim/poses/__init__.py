"""Still poses measured by any instrument: the true robot, its poses, the readings, the files."""

"""Plans of still poses: which poses an instrument should measure to determine the robot best."""

"""What stands in the cell: descriptions, kinematics, and what recordings are. Imports none of the other packages."""

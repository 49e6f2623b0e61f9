"""What stands in the cell: descriptions, kinematics, what recordings are; and what all packages share. Imports none of them."""

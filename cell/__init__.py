"""The cell: descriptions, kinematics, logs, and what all packages share."""

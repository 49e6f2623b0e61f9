"""The closed mechanism: MuJoCo model, kinematic plant, statics oracle."""

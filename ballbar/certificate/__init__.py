"""The certificate of a calibration: what a quality system files, recomputed from its inputs."""

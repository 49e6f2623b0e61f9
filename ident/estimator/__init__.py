"""Whitened loop closure, its linearisation, the damped Gauss-Newton loop and the covariance."""

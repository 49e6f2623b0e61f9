"""Statements of the thesis against results of simulated runs."""

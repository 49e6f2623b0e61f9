"""Identifiability of the parameters by a cost, on the nominal mechanism of a scenario."""

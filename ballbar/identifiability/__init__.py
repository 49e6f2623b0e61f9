"""What a cost can identify of the parameters, on the nominal mechanism of a scenario."""

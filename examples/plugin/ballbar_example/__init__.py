"""Plug-ins of ballbar, one of each kind."""

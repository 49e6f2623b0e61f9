"""Descriptions of robots made from a URDF or a table of DH rows: checked, written, drawn."""

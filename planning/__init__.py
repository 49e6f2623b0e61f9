"""Paths for the cell: found, judged before anyone goes there, checked, and written for the
controller.
"""

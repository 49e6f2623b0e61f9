"""Identification from still poses: a table of joint angles and measurements, without clocks."""

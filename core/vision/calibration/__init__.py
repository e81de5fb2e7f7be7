"""Calibration of cameras, floor and time offsets."""

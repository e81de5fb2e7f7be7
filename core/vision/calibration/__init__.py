"""Calibrate cameras, floor and time offsets."""

"""Operators, by panel."""

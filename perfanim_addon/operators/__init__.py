"""Operators, grouped by panel."""

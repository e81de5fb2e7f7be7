"""Measure a performer's skeleton and marker offsets."""

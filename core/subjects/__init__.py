"""Subjects: measuring a performer's skeleton and marker offsets."""

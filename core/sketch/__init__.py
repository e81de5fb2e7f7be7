"""Sketches: a motion roughed out by a few keyframed controls."""

"""Sketches: motion roughed out with a few keyframed controls."""

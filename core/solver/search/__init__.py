"""Nearest-neighbour search in the motion database."""

"""Nearest-neighbour searches in the motion database."""

"""Skeletons, poses and motion."""

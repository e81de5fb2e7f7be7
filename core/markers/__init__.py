"""Markers: sets, subjects, frames, takes, gaps and filters."""

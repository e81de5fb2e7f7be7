"""Matching the blobs of several cameras in space and time."""

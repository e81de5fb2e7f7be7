"""Matching of the blobs of several cameras in space and time."""

"""Labelling: assignment of marker names to points and blobs."""

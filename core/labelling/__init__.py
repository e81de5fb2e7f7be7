"""Assign marker names to points and blobs."""

"""Simulated studio: cameras, body, room and boards, their images, and the ground truth."""

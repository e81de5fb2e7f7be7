"""Simulated studio: cameras, body, room, boards, their images and all truth."""

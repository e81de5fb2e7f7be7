"""Armatures that are driven, and the character of our own."""

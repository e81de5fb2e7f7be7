"""Retargeting: bone maps of humanoid armatures, and motion onto them."""

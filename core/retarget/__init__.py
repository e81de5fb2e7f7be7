"""Retargeting: bone maps for humanoid armatures, and transfer of motion to them."""

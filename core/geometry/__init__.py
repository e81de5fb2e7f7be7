"""Rotations, rigid transforms, point patterns, cameras and triangulation."""

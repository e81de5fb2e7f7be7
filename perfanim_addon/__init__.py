"""The Blender side: thin operators and panels on top of `core`."""

from .registration import register, unregister

__all__ = ["register", "unregister"]

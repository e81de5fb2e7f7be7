"""The Blender side: thin operators and panels over `core`."""

from .registration import register, unregister

__all__ = ["register", "unregister"]

"""Performance animation from a few markers: everything that does not need Blender."""

__version__ = "0.1.0"

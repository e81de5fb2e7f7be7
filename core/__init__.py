"""Performance animation from a few markers: all code that does not need Blender."""

from pathlib import Path

__version__ = "0.1.0"  # keep equal to the version in Blender's manifest; pyproject.toml reads it here

PACKAGE_ROOT = Path(__file__).resolve().parent.parent  # folder of the installed package or extension

"""Performance animation from a few markers: everything that does not need Blender."""

from pathlib import Path

__version__ = "0.1.0"  # the manifest's, too; pyproject.toml reads it here

PACKAGE_ROOT = Path(__file__).resolve().parent.parent  # the extension's folder

"""Marker files: C3D, TRC, CSV, TSV and the project's own."""

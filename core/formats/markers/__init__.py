"""Marker files: C3D, TRC, CSV, TSV and our own formats."""

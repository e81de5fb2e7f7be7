"""Preferences, folders and diagnostics."""

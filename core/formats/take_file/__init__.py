"""Recorded takes: files written during a capture; see docs/take-format.md."""

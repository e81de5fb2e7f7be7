"""Batches: many takes tracked, solved and retargeted in parallel."""

"""Exports: an identified car, its results, and runs in the formats of other programs."""

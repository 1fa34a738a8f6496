"""Figures of values and plain data, drawn with matplotlib."""

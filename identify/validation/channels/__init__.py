"""Faults of single channels: values that stand still, copies, and what the car's own equations say of each channel."""

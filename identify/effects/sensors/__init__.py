"""Faults of the sensors: gain, drift, latency, misalignment, position, crosstalk."""

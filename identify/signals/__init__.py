"""Sampled signals: filters, derivatives, the noise of the sensors, time bases, mounting of the sensors."""

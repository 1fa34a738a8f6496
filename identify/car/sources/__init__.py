"""Laws of channels that a rig does not measure, and the choice of a source for each channel the rows need."""

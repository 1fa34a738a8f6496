"""Model selection: which effect of the catalogue is missing in a fitted model, or that none is."""

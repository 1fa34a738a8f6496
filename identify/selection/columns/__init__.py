"""Columns of model, sensor sheet and candidates on the runs of a fit, and the sums over them."""

"""Files: the run log in MCAP, exchange tables, MDF4, machine-readable results."""

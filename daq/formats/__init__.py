"""File formats: run logs in MCAP, exchange tables, MDF4, machine-readable results."""

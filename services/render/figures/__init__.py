"""Pictures for people: matplotlib figures of values and plain data."""

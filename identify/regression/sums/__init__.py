"""Sums over runs that a fit is made of: what each run gives by itself, and how those of many are merged."""

"""Campaign: fit and ranking over many runs, each run a task of its own, on one machine or on several (Dask)."""

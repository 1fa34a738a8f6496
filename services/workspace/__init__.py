"""The workspace: studies in folders, runs loaded and checked, fits and rankings kept, results as plain data."""

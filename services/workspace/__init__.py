"""The workspace: studies in folders, runs loaded and checked, fits and rankings made and kept, results as plain data."""

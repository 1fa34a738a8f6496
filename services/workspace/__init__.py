"""Workspace: studies in folders, runs loaded and checked, fits and rankings made and stored, results as plain data."""

"""Weighted least squares: equations of prepared runs, the fit, its intervals, and what runs can identify."""

"""Vertical laws of the tyres, and their other forces, which the wheel dynamometers measure."""

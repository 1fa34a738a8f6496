"""Vertical laws of the tyres, and what the wheel dynamometers measure of their other forces."""

"""Wheel loads of a run without dynamometers, observed with a model that was identified with them."""

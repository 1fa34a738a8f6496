"""Reproduction of the paper: its campaigns simulated and fitted, its tables 1 to 7 beside lacet's."""

"""Vocabulary of measurements, rigs, vehicles and runs, with the formats and the bus that store and move them."""

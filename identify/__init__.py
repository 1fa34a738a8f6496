"""Identification: chain (modified DH) → motion → model (a sum of effects) → fit → diagnosis. Arrays in, arrays out."""

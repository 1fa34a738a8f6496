"""Identification: chain (modified DH), motion, model (a sum of effects), fit, diagnosis; arrays in, values out."""

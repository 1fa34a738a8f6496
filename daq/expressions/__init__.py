"""Arithmetic expressions with units, as users write them: parsed, checked for dimensions, never executed."""

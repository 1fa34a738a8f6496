"""Laws of the measured states that the residual of an unlisted cause follows: grammar, search, names."""

"""Several effects at once: the set that together explains the residual, and its shape constants."""

"""Half-width of the intervals that are given everywhere."""

TWO_SIDED_95 = 1.96
"""Half of a 95 % interval [σ]. Source: the normal distribution."""

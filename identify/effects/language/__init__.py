"""Language of one-line effects: expressions in the measured states, with units, linear in their parameters."""

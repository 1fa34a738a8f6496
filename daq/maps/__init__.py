"""Channel maps: which names of a log, in which units, are which channel; and the runs made by them."""

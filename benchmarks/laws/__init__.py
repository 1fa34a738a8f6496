"""Does the search for a formula find laws that nobody listed? Laws by function, hidden in fresh simulated cars."""

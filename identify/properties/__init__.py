"""Engineering properties of a fit: mass and inertia of the vehicle, rates, ride, consistency of bodies."""

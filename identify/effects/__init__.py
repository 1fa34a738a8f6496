"""Physical effects and sensor faults, the terms of a model: base classes, catalogue, and users' own effects."""

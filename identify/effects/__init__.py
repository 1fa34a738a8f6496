"""Physical effects and sensor faults: what each is, the catalogue of them, and those that users write."""

"""Any chain of joints identified from sampled positions and torques: laws of joints, fit, held-out error, ranking."""

"""Trees of rigid bodies: geometry, dynamics that are linear in the parameters, base parameters, SYMORO files."""

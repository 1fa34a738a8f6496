"""URDF files read as tables of modified Denavit–Hartenberg rows."""

"""Masses and their carriers: rigid bodies, payload, unsprung mass, engine mounts, a chassis that twists."""

"""The car as a robot of 42 bodies: its tree, its kinematics on a road, and the rows of its equations of motion."""

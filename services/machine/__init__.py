"""What lacet finds on this computer: packages, wires, clock, disk, browser; and what to do where something is amiss."""

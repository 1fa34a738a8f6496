"""How long the workbench takes to list long runs, to draw 50 of their channels, and to zoom these together."""

"""The Python library: what `import lacet` offers for notebooks and scripts, on top of workspace and render."""

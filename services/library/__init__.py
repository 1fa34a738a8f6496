"""Python library: functions and objects of `import lacet` for notebooks and scripts, on top of workspace and render."""

"""How long an engineer waits for each command, against the commit f0e8420 and against itself the second time."""

"""Values of a study: its runs, what was computed of them and is kept, and the plan of what is still to be computed."""

"""The measurement vocabulary of lacet and how data is stored and moved."""

"""Time of a job: what its stages usually take, what they took the last time, the share done and the remaining time."""

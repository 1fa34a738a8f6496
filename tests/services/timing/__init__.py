"""Time of a job: share done and time left."""

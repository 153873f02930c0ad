"""The run store: one directory for each run, one SQLite file in it, nothing acknowledged that is not durable."""

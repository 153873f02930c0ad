"""Run store: one directory per run with one SQLite file; a write is acknowledged only once it is durable."""

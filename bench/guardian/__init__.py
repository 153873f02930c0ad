"""The guardian of a run: a process of its own that makes the bench safe when the run's process dies or stands still."""

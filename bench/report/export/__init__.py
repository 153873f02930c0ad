"""A run's data as files for other programs."""

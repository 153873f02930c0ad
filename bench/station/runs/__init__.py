"""Runs of a station: which there are, what happens in one that is under way, and what one that has ended contains."""

"""A plan before its run: timeline and picture."""

"""Hostile trials: what the records, the safe state and the numbers withstand, counted."""

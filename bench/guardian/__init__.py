"""Guardian of a run: independent process that makes the bench safe if the process of the run dies or hangs."""

"""True values of a simulated unit, as a perfect bench would measure them; shares no code with the reductions."""

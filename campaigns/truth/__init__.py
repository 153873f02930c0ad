"""Results of simulated runs against the truth of the simulation, over seeds, units and planted errors."""

"""The world shared by all simulated instruments: attitude, gravity, temperatures, motion."""

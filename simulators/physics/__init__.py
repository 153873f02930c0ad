"""The world that all simulated instruments share: attitude, gravity, temperatures, motion."""

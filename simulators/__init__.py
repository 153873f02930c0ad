"""The simulated laboratory: one physics, and instruments with their real protocols."""

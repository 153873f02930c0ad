"""The laboratory in software: one physics, and instruments that speak their real protocols."""

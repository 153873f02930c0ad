"""Reduction of legs to the dynamic characteristic."""

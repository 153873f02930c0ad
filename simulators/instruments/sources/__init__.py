"""Supplies, current sources and calibrators."""

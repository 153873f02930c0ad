"""Fluke 5700A, 5720A and 5730A calibrators as precision current sources."""

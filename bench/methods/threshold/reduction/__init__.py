"""Reduction of ladders of small steps to a threshold."""

"""Reduction of the acquisitions of a channel to findings."""

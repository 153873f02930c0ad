"""Instrument drivers and their connections; usable without the bench."""

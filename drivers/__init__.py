"""Instruments and the wires to them; usable without the bench."""

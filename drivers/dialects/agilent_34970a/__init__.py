"""Agilent (HP, Keysight) 34970A and 34972A scanners as thermometers."""

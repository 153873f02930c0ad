"""Keysight 3458A (also HP, Agilent) multimeters as voltmeters."""

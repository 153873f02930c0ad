"""Keithley 6220 and 6221 precision current sources."""

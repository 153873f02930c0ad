"""Method M1: static calibration on an indexing table, on both ends."""

"""The report of an approved run as a Digital Calibration Certificate."""

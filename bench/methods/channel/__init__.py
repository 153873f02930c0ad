"""Method M0: an accelerometer channel over temperature and input level."""

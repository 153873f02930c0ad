"""Method M4d: threshold and resolution."""

"""Units under test: from specific force, rotation and temperature to pulses, currents and codes."""

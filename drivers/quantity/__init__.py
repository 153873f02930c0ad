"""Numbers with units, and units of measure."""

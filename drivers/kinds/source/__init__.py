"""Current sources that are spoken to in SCPI: what their dialects share."""

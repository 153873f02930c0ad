"""Laboratory power supplies that keep to the common core of SCPI."""

"""Laboratory power supplies that comply with the common core of SCPI."""

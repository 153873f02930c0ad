"""Method M3: range and frequency response on a rate table."""

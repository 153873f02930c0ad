"""Method M4b: the bias on temperature ramps."""

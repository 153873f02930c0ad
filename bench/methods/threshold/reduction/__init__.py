"""From ladders of small steps to a threshold."""

"""Time limits and read-back loops."""

"""From rates and swings to errors over the range, gain and phase."""

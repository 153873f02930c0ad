"""CTS chambers, by their ASCII protocol."""

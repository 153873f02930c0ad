"""The value language of a sequence: expressions, lists and ranges, units of what is read."""

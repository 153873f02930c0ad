"""Value language of a sequence: expressions, lists and ranges, units of readings."""

"""The test methods, one folder each: description, rules, reduction, off-line cases, tables and plots."""

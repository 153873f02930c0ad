"""Drivers on bad lines: every kind of fault, on every dialect, against what the instrument really said."""

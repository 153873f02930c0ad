"""Patterns of names, none of which can be a path or an option."""

WORD = r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}"
BENCH = r"[a-z][a-z0-9_]{0,31}"

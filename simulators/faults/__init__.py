"""Faults of instruments, lines and buses."""

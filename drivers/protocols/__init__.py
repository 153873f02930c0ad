"""Protocols shared by several instruments, as text and bytes; no I/O."""

"""Simulated instruments, each with the protocol of the real one."""

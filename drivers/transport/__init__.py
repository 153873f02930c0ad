"""Wires: serial lines, TCP, Modbus, CAN, and their in-process twins. Nothing here knows an instrument."""

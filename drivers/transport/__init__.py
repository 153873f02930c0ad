"""Connections: serial lines, TCP, Modbus, CAN, and in-process equivalents; independent of instruments."""

"""Watlow F4 chamber controllers over Modbus RTU."""

"""Watlow F4T chamber controllers over Modbus TCP."""

"""Binder chambers with an MB1 or MB2 controller over Modbus RTU, on serial lines and behind serial servers."""

"""Chambers whose controller speaks Modbus and is described by a file: its registers, modes, ramp and alarms."""

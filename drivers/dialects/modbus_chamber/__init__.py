"""Chambers with a Modbus controller described by a profile file: registers, modes, ramp and alarms."""

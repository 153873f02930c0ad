"""Devices that send CAN frames by themselves."""

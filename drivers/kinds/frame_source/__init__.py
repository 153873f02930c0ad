"""Devices that send CAN frames unsolicited."""

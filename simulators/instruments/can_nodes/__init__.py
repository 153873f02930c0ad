"""Nodes that send CAN frames by themselves."""

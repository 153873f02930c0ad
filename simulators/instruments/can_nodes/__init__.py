"""Nodes that send CAN frames unsolicited."""

"""Notifications to systemd, sd_notify(3): datagrams to the socket in $NOTIFY_SOCKET, if set."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

VARIABLE = "NOTIFY_SOCKET"


def notify(*words: str) -> None:
    """Send words such as READY=1; errors are ignored, since they do not concern the run."""
    name = os.environ.get(VARIABLE, "")
    if not name.startswith(("/", "@")):
        return
    address = f"\0{name[1:]}" if name.startswith("@") else name
    text = "\n".join(word.replace("\n", " ") for word in words)
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.setblocking(False)
        sender.sendto(text.encode(), address)

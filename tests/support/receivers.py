"""Receivers of alerts on loopback: a web hook and a mail server, that keep what they are sent."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from aiosmtpd.controller import Controller


class Webhook:
    """Web hook: its address for a route, what it was sent, and the status that it answers with."""

    def __init__(self, port: int, received: list[dict[str, Any]]) -> None:
        self.url, self.received = f"json://127.0.0.1:{port}/hook/s3cret-token", received
        self.status = 200
        self.on_receipt: Callable[[], object] = lambda: None

    @property
    def titles(self) -> list[str]:
        """Titles of all messages."""
        return [each["title"] for each in self.received]


@contextmanager
def webhook() -> Iterator[Webhook]:
    """A web hook until the block ends."""
    received: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            received.append(json.loads(self.rfile.read(int(self.headers["content-length"]))))
            hook.on_receipt()
            self.send_response(hook.status)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    hook = Webhook(server.server_address[1], received)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield hook
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class Mails:
    """Handler of a mail server that keeps all messages."""

    def __init__(self) -> None:
        self.received: list[str] = []

    async def handle_DATA(self, _server: object, _session: object, envelope: Any) -> str:  # noqa: N802  its interface
        """Keep a message."""
        self.received.append(envelope.content.decode())
        return "250 kept"


@contextmanager
def mail_server() -> Iterator[tuple[str, Mails]]:
    """A mail server until the block ends: the address for a route, and its messages."""
    mails = Mails()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    controller = Controller(mails, hostname="127.0.0.1", port=port)
    controller.start()
    try:
        yield f"mailto://127.0.0.1:{port}/?from=bench@example.org&to=anna@example.org&mode=insecure", mails
    finally:
        controller.stop()


@contextmanager
def dead_server() -> Iterator[str]:
    """A server that accepts connections and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield f"json://127.0.0.1:{listener.getsockname()[1]}/hook"

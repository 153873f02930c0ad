"""Servers that answer as no station should: nothing, half an answer, or something else."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from bench.client import Station


@contextmanager
def answering(*answers: bytes, then_hangs: bool = False) -> Iterator[tuple[Station, list[bytes]]]:
    """Yield a client, and the requests that a server has received; it gives one answer to each, and hangs up.

    With `then_hangs` it keeps the connection after the last answer.
    """
    received: list[bytes] = []
    kept: list[socket.socket] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            for number, answer in enumerate(answers):
                with suppress(OSError):
                    connection, _ = listener.accept()
                    received.append(_request(connection))
                    connection.sendall(answer)
                    if then_hangs and number == len(answers) - 1:
                        kept.append(connection)
                    else:
                        connection.close()

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield Station(f"http://127.0.0.1:{listener.getsockname()[1]}/", "secret", limit_s=0.5), received
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            thread.join()
            for connection in kept:
                connection.close()


def json_answer(text: str, status: str = "200 OK", more: int = 0) -> bytes:
    """Return an answer; it announces `more` bytes than it has."""
    head = f"HTTP/1.1 {status}\r\ncontent-type: application/json\r\ncontent-length: {len(text.encode()) + more}"
    return f"{head}\r\nconnection: close\r\n\r\n{text}".encode()


def _request(connection: socket.socket) -> bytes:
    """Return a request as far as its head announces a body."""
    found = b""
    while b"\r\n\r\n" not in found:
        found += connection.recv(65536)
    head, _, body = found.partition(b"\r\n\r\n")
    length = next((int(line[15:]) for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:")), 0)
    while len(body) < length:
        body += connection.recv(65536)
    return head + b"\r\n\r\n" + body

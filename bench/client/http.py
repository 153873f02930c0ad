"""Requests to the API of a station, each within a time limit, and its errors as those of the bench."""

from __future__ import annotations

import json
import socket
import ssl
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

from bench.client.address import Address
from bench.clock import Stopwatch
from bench.errors import BenchError, InputError, StaleError

ANSWER_LIMIT_BYTES = 2**26
_FAILED = 500  # and above: the station, not the request


class NoStation(BenchError):
    """Station that cannot be reached; no request was sent."""

    code = "no-station"


class NoReply(BenchError):
    """Request that was sent and not answered in time; it may have been carried out."""

    code = "no-reply"


class Http:
    """Sender of requests to one station. Each request has a connection of its own, so that threads can share it."""

    def __init__(self, address: Address) -> None:
        try:
            parts = urlsplit(address.url)
            self._host, self._port = parts.hostname or "", parts.port
        except ValueError:
            parts = urlsplit("")
        if parts.scheme not in ("http", "https") or not self._host or parts.username:
            raise InputError(f"'{address.url}' is not the address of a station, such as http://127.0.0.1:8421/")
        if not address.token.isascii() or not address.token.isprintable():
            raise InputError(f"the token for {parts.netloc} has characters that no token has")
        self.url = f"{parts.scheme}://{parts.netloc}"
        self._tls = _trusting(address.certificate) if parts.scheme == "https" else None
        self._headers = {"authorization": f"Bearer {address.token}", "accept": "application/json"}

    def call(
        self, method: str, path: str, content: Any = None, *, limit_s: float, query: Mapping[str, Any] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Any:  # fmt: skip
        """Send a request; return the content of its answer, None if it is empty.

        Raises NoStation, NoReply, InputError and StaleError in the words of the station, else BenchError.
        """
        body = None if content is None else json.dumps(content).encode()
        more = {"content-type": "application/json"} if body is not None else {}
        with self.opened(method, _target(path, query), body, {**more, **(headers or {})}, limit_s) as (answer, limit):
            if answer.length is None:  # http.client takes a head that was cut off for a complete one
                raise NoReply(f"{self.url}: the answer of the station was cut off")
            if answer.length > ANSWER_LIMIT_BYTES:
                raise BenchError(f"{self.url}: its answer has more than {ANSWER_LIMIT_BYTES} bytes")
            with limit:
                data = answer.read()
        try:
            return json.loads(data) if data else None
        except ValueError:
            raise BenchError(f"{self.url}: its answer is not that of a station") from None

    @contextmanager
    def opened(
        self, method: str, target: str, body: bytes | None, headers: Mapping[str, str], limit_s: float
    ) -> Iterator[tuple[HTTPResponse, Limit]]:
        """Yield the answer to a request, without its content, and the limit that its connection is under.

        Raises as `call` does.
        """
        connection, watch = self._connection(limit_s), Stopwatch()
        try:
            try:
                connection.connect()
            except (OSError, ValueError) as problem:
                raise NoStation(f"{self.url}: the station cannot be reached ({problem})") from problem
            limit = Limit(connection.sock, limit_s, watch)
            try:
                with limit:
                    connection.request(method, target, body, {**self._headers, **headers})
                    answer = connection.getresponse()
                    if answer.status >= 300:
                        raise _error(answer.status, _detail(answer.read(ANSWER_LIMIT_BYTES)), self.url)
                yield answer, limit
            except (OSError, HTTPException) as problem:
                raise NoReply(f"{self.url}: the station has not answered ({problem})") from problem
        finally:
            connection.close()

    def _connection(self, limit_s: float) -> HTTPConnection:
        if self._tls is not None:
            return HTTPSConnection(self._host, self._port, timeout=limit_s, context=self._tls)
        return HTTPConnection(self._host, self._port, timeout=limit_s)


class Limit:
    """Time limit of blocks that use a socket: when it is over the socket is shut down, whatever has arrived so far."""

    def __init__(self, used: socket.socket, limit_s: float, since: Stopwatch) -> None:
        self._used, self._limit_s, self._since = used, limit_s, since
        self._timer = threading.Timer(0.0, str)

    def __enter__(self) -> None:
        self._timer = threading.Timer(max(0.0, self._limit_s - self._since.elapsed_s()), self._shut)
        self._timer.daemon = True
        self._timer.start()

    def __exit__(self, *exc: object) -> None:
        self._timer.cancel()

    def _shut(self) -> None:
        with suppress(OSError):
            self._used.shutdown(socket.SHUT_RDWR)


def _target(path: str, query: Mapping[str, Any] | None) -> str:
    given = {name: value for name, value in (query or {}).items() if value not in (None, "")}
    return f"/api/v1/{path}" + (f"?{urlencode(given)}" if given else "")


def _trusting(certificate: Path | None) -> ssl.SSLContext:
    """Return a context that accepts one certificate alone, under any host name, or those that the system trusts."""
    if certificate is None:
        return ssl.create_default_context()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False  # the certificate itself is known
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    try:
        context.load_verify_locations(certificate)
    except OSError as problem:
        raise InputError(f"{certificate}: this certificate of the station cannot be used ({problem})") from problem
    return context


def _error(status: int, detail: str, url: str) -> BenchError:
    if status == 409:
        return StaleError(detail)
    if status >= _FAILED or status < 400:
        return BenchError(f"{url}: the station has failed: {detail} (HTTP {status})")
    return InputError(*(detail.splitlines() or [f"{url}: refused (HTTP {status})"]))


def _detail(data: bytes) -> str:
    try:
        return str(json.loads(data)["detail"])
    except (ValueError, KeyError, TypeError):
        return data[:300].decode(errors="replace")

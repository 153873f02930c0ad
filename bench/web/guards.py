"""Guards of all requests: host, size, origin, sender, rate, and the headers of all answers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import ExitStack
from ipaddress import ip_address

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bench.clock import Stopwatch
from bench.errors import StoreError
from bench.web.access import Person
from bench.web.access import Scope as Right
from bench.web.cookies import secret_in
from bench.web.identity import Identity
from bench.web.limits import BusyError, Limits, makes_safe
from bench.web.origins import host_is_allowed, is_admitted

HEADER_LIMIT_BYTES, BODY_LIMIT_BYTES, BODY_OF_NOBODY_BYTES = 2**13, 2**20, 2**14
BODY_S, BODY_OF_NOBODY_S = 60.0, 10.0
POLL = "bench-poll"  # header of what a page asks for by itself
ASKED_AGAIN_S = 5.0  # whether the reader of a stream may still read
CSP = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": CSP,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    # With no-referrer, browsers would send the forms of our own pages with "Origin: null".
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}
SECURE_HEADERS = {"strict-transport-security": "max-age=31536000"}


class _RefusedError(Exception):
    """Request that is not admitted."""

    def __init__(self, status: int, why: str, headers: dict[str, str] | None = None) -> None:
        self.status, self.why, self.headers = status, why, headers
        super().__init__(why)


class Guards:
    """ASGI middleware in front of all routes. `hosts` are the allowed host names; `secure` is True behind TLS."""

    def __init__(self, app: ASGIApp, identity: Identity, hosts: frozenset[str], *, secure: bool) -> None:
        self._app, self._identity, self._hosts, self._secure = app, identity, hosts, secure
        self._limits = Limits()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on if it is admitted."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return  # there are no web sockets
        headers = Headers(scope=scope)
        answer = _with_headers(send, HEADERS | (SECURE_HEADERS if self._secure else {}))
        try:
            with ExitStack() as stack:
                await self._admit(scope, headers, receive, answer, stack)
        except _RefusedError as problem:
            await JSONResponse({"detail": problem.why}, problem.status, problem.headers)(scope, receive, answer)
        self._identity.keep_uses()

    async def _admit(self, scope: Scope, headers: Headers, receive: Receive, send: Send, stack: ExitStack) -> None:
        """Pass a request on, counted until `stack` is closed. Raises _RefusedError."""
        self._expect_form(scope, headers)
        if not is_admitted(scope["method"], headers, "https" if self._secure else "http"):
            raise _RefusedError(403, "send a token; without one, only pages of this station may do this")
        person = self._person(scope, headers, uses=not _is_poll(scope, headers))
        scope.setdefault("state", {})["person"] = person
        if person is not None and makes_safe(scope["method"], scope["path"]) and Right.STOP in person.scopes:
            await self._app(scope, receive, send)  # at once, whatever else is going on, and without its body
            return
        try:
            stack.enter_context(self._limits.request(_sender(scope, person)))
        except BusyError as problem:
            raise _RefusedError(429 if problem.is_of_sender else 503, str(problem), {"retry-after": "1"}) from None
        receive = await _with_body(receive, person)
        if person is not None:
            send = _while_allowed(send, lambda: self._still(scope, headers, person))
        await self._app(scope, receive, send)

    def _expect_form(self, scope: Scope, headers: Headers) -> None:
        """Refuse a request with a wrong host, or headers or a body that are too long."""
        sizes = [len(name) + len(value) for name, value in headers.raw]
        if sum(sizes, len(scope.get("raw_path", b"")) + len(scope["query_string"])) > HEADER_LIMIT_BYTES:
            raise _RefusedError(431, f"the headers of a request have at most {HEADER_LIMIT_BYTES} bytes")
        if not host_is_allowed(headers, self._hosts):
            raise _RefusedError(421, "this station is not known by this host name; 'bench serve --name' adds one")
        length = headers.get("content-length", "0")
        if not length.isascii() or not length.isdigit() or len(length) > 10 or int(length) > BODY_LIMIT_BYTES:
            raise _too_long(BODY_LIMIT_BYTES)

    def _person(self, scope: Scope, headers: Headers, *, uses: bool = True) -> Person | None:
        """Return the sender of a request, with its address; None if unknown. A token goes before a cookie."""
        given = headers.getlist("authorization")
        try:
            if given:
                kind, _, secret = given[0].partition(" ")
                is_token = len(given) == 1 and kind.lower() == "bearer"
                found = self._identity.of_token(secret.strip(), uses=uses) if is_token else None
            else:
                secret = secret_in(headers, secure=self._secure)
                found = self._identity.of_session(secret, uses=uses) if secret else None
        except StoreError as problem:
            raise _RefusedError(503, str(problem)) from None
        return found._replace(address=address_of(scope)) if found is not None else None

    def _still(self, scope: Scope, headers: Headers, person: Person) -> bool:
        """Return True if the sender of a request still has the rights that it had."""
        try:
            now = self._person(scope, headers, uses=False)
        except _RefusedError:
            return False
        return now is not None and person.scopes <= now.scopes


def _is_poll(scope: Scope, headers: Headers) -> bool:
    """Return True for a question that an open page repeats by itself: it does not keep a session alive."""
    return scope["method"] == "GET" and POLL in headers


def address_of(scope: Scope) -> str:
    """Return the address that a request comes from; "" if unknown."""
    client = scope.get("client")
    return str(client[0]) if client is not None else ""


def is_this_computer(scope: Scope) -> bool:
    """Return True if a request comes from a loopback address."""
    try:
        return ip_address(address_of(scope)).is_loopback
    except ValueError:
        return False


def _sender(scope: Scope, person: Person | None) -> str:
    return f"{person.how} {person.id}" if person is not None else address_of(scope)


def _with_headers(send: Send, added: dict[str, str]) -> Send:
    async def answer(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in added.items():
                headers.setdefault(name, value)
        await send(message)

    return answer


async def _with_body(receive: Receive, person: Person | None) -> Receive:
    """Return `receive` of a request whose body has come, so that no route waits for it. Raises _RefusedError."""
    limit = BODY_LIMIT_BYTES if person is not None else BODY_OF_NOBODY_BYTES
    body, more = bytearray(), True
    try:
        async with asyncio.timeout(BODY_S if person is not None else BODY_OF_NOBODY_S):
            while more:
                message = await receive()
                if message["type"] != "http.request":
                    return receive  # it has gone
                body += message.get("body", b"")
                more = message.get("more_body", False)
                if len(body) > limit:
                    raise _too_long(limit)
    except TimeoutError:
        raise _RefusedError(408, "the request did not come to its end in time; send it again") from None
    whole: list[Message] = [{"type": "http.request", "body": bytes(body), "more_body": False}]

    async def again() -> Message:
        return whole.pop() if whole else await receive()

    return again


def _while_allowed(send: Send, still: Callable[[], bool]) -> Send:
    """Return `send` that ends a stream whose reader has lost the rights to it."""
    watch, has_ended = Stopwatch(), False

    async def answer(message: Message) -> None:
        nonlocal watch, has_ended
        if has_ended:
            return
        if message.get("more_body") and watch.elapsed_s() > ASKED_AGAIN_S:
            watch = Stopwatch()
            if not still():
                has_ended = True
                message = {"type": "http.response.body", "body": b"", "more_body": False}
        await send(message)

    return answer


def _too_long(limit: int) -> _RefusedError:
    return _RefusedError(413, f"a request has at most {limit} bytes")

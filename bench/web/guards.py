"""Guards of all requests: host, size, origin, sender, and the headers of all answers."""

from __future__ import annotations

from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bench.web.access import Person
from bench.web.identity import Identity

COOKIE = "bench_session"
BODY_LIMIT_BYTES = 2**20
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
CSP = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": CSP,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",  # without a referrer a browser sends forms without an origin
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}


class Guards:
    """ASGI middleware in front of all routes. `hosts` are the allowed host names; `secure` is True behind TLS."""

    def __init__(self, app: ASGIApp, identity: Identity, hosts: frozenset[str], *, secure: bool) -> None:
        self._app, self._identity, self._hosts, self._secure = app, identity, hosts, secure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on if it is admitted."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return  # there are no web sockets
        headers = Headers(scope=scope)
        answer = _with_headers(send)
        if problem := self._refused(scope, headers):
            await JSONResponse({"detail": problem[1]}, problem[0])(scope, receive, answer)
            return
        person = self._person(headers)
        if scope["method"] not in SAFE and _of_browser(person, headers) and not self._is_own(headers):
            await JSONResponse({"detail": "this request did not come from a page of this station"}, 403)(
                scope, receive, answer
            )
            return
        scope.setdefault("state", {})["person"] = person
        await self._app(scope, _bounded(receive), answer)

    def _refused(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._is_allowed(hosts[0]):
            return 421, "this station is not known by this host name"
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > BODY_LIMIT_BYTES:
            return 413, f"a request has at most {BODY_LIMIT_BYTES} bytes"
        return None

    def _is_allowed(self, host: str) -> bool:
        try:
            found = urlsplit(f"//{host}")
            name, _ = found.hostname, found.port
        except ValueError:
            return False
        return name is not None and name in self._hosts and "@" not in host and found.path == ""

    def _person(self, headers: Headers) -> Person | None:
        kind, _, secret = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer":
            return self._identity.of_token(secret.strip())
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return None
        return self._identity.of_session(cookie.value) if cookie is not None else None

    def _is_own(self, headers: Headers) -> bool:
        """Return True for a request that a page of this station has sent, by the browser's own words."""
        if (site := headers.get("sec-fetch-site")) is not None and site != "same-origin":
            return False
        origin = headers.get("origin")
        scheme = "https" if self._secure else "http"
        return origin is not None and origin == f"{scheme}://{headers['host']}"


def _of_browser(person: Person | None, headers: Headers) -> bool:
    """Return True for a request of a session, and for one without a token that names an origin, as that of a login."""
    return person.how == "session" if person is not None else "origin" in headers


def is_this_computer(scope: Scope) -> bool:
    """Return True if a request comes from a loopback address."""
    client = scope.get("client")
    try:
        return client is not None and ip_address(client[0]).is_loopback
    except ValueError:
        return False


def _with_headers(send: Send) -> Send:
    async def answer(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return answer


def _bounded(receive: Receive) -> Receive:
    """Return `receive` that ends a body beyond the limit, whatever its declared length."""
    passed = 0

    async def bounded() -> Message:
        nonlocal passed
        message = await receive()
        passed += len(message.get("body", b""))
        return {"type": "http.disconnect"} if passed > BODY_LIMIT_BYTES else message

    return bounded

"""Cookie of a session."""

from __future__ import annotations

from typing import Any

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import Response

COOKIE = "bench_session"
SECURE_COOKIE = f"__Host-{COOKIE}"  # a browser accepts it from this very host by TLS only


def secret_in(headers: Headers, *, secure: bool) -> str:
    """Return the secret of the session in the headers of a request; "" without one, or with two."""
    pairs = [each.strip().partition("=") for line in headers.getlist("cookie") for each in line.split(";")]
    found = [value for name, _, value in pairs if name == (SECURE_COOKIE if secure else COOKIE)]
    return found[0] if len(found) == 1 else ""


def secret_of(request: Request) -> str:
    """Return the secret of the session of a request; "" without one."""
    return secret_in(request.headers, secure=_is_secure(request))


def keep_session(request: Request, response: Response, secret: str) -> None:
    """Let the browser keep the secret of a new session."""
    response.set_cookie(value=secret, **_kind(request))


def forget_session(request: Request, response: Response) -> None:
    """Let the browser forget the session."""
    response.delete_cookie(**_kind(request))


def _kind(request: Request) -> dict[str, Any]:
    secure = _is_secure(request)
    name = SECURE_COOKIE if secure else COOKIE
    return {"key": name, "httponly": True, "samesite": "strict", "secure": secure, "path": "/"}


def _is_secure(request: Request) -> bool:
    return request.url.scheme == "https"

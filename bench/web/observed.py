"""Each request in the log and in the metrics; no query, header or body, since these hold secrets."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bench.clock import Stopwatch
from bench.station.log import Log
from bench.web.metrics import Metrics

METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})


class Observed:
    """ASGI middleware around all others. `metrics` and `log` may be missing."""

    def __init__(self, app: ASGIApp, metrics: Metrics | None, log: Log | None) -> None:
        self._app, self._metrics, self._log = app, metrics, log

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on; its answer counts when it begins, since a stream may last for days."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        watch = Stopwatch()

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._answered(scope, int(message["status"]), watch.elapsed_s())
            await send(message)

        await self._app(scope, receive, answer)

    def _answered(self, scope: Scope, status: int, took_s: float) -> None:
        route = getattr(scope.get("route"), "path", "other")
        method = scope["method"] if scope["method"] in METHODS else "other"
        if self._metrics is not None:
            self._metrics.request(method, route, status, took_s)
        if self._log is not None:
            person = scope.get("state", {}).get("person")
            self._log.info(
                "request", method=scope["method"], path=scope["path"], status=status, took_s=round(took_s, 4),
                who=person.name if person is not None else "", client=(scope.get("client") or ("",))[0],
            )  # fmt: skip

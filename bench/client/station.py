"""Station as scripts and commands see it: queue, runs in progress and their events, people."""

from __future__ import annotations

import json
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self
from urllib.parse import quote

from bench.client.address import Address, found_address
from bench.client.http import Http, NoReply, NoStation
from bench.client.sse import LINE_LIMIT_BYTES, server_events
from bench.clock import Stopwatch
from bench.errors import BenchError, InputError

LIMIT_S = 30.0
CHECKED_WITHIN_S = 90.0  # a station ends a check after 60 s
SILENT_LIMIT_S = 45.0  # a stream has a sign of life each 15 s
AGAIN_EVERY_S = 0.5
OPENED = ""  # kind of the first event of a stream, which the station does not send
FINAL = frozenset({"ended", "refused", "cancelled"})
HOW_TO_START = "no station runs for this user; 'bench serve' starts one, or set BENCH_STATION and BENCH_TOKEN"

Json = dict[str, Any]
_pause = threading.Event().wait


class Station:
    """Client of a station; answers are the JSON of its API. Threads can share it.

    All methods raise InputError and StaleError in the words of the station, NoStation if it cannot be reached, NoReply
    if it has not answered within `limit_s`, and BenchError if it has failed.
    """

    def __init__(
        self, url: str, token: str, *, certificate: Path | None = None, runs: Path | None = None,
        limit_s: float = LIMIT_S,
    ) -> None:  # fmt: skip
        self._http, self.runs_folder, self.limit_s = Http(Address(url, token, certificate)), runs, limit_s

    @classmethod
    def found(cls, folder: Path | None = None, *, limit_s: float = LIMIT_S) -> Self:
        """Return the station of $BENCH_STATION, else that of a folder, by default this user's.

        Raises NoStation if none runs, and InputError.
        """
        if (address := found_address(folder)) is None:
            raise NoStation(HOW_TO_START)
        return cls(address.url, address.token, certificate=address.certificate, runs=address.runs, limit_s=limit_s)

    @property
    def url(self) -> str:
        """Address of the station, without a path."""
        return self._http.url

    def me(self) -> Json:
        """Return who the token belongs to, and its scopes."""
        return self._get("me")

    def state(self) -> Json:
        """Return the benches with their runs in progress and waiting items."""
        return self._get("station")

    def queue(self, *, past: bool = False) -> list[Json]:
        """Return the items that run or wait, in order, with estimated begin and end; with `past` all items."""
        return self._list("queue", all_=past)

    def item(self, item: str) -> Json:
        """Return an item by its id."""
        return self._get(f"queue/{_part(item)}")

    def submit(self, sequence: str, bench: str, *, key: str = "", held: bool = False, **more: Any) -> Json:
        """Append an item to the queue, and return it; `more` are fields such as `units`, `settings` or `priority`.

        A station that is restarted meanwhile is asked again, within `limit_s`; the key makes this one item.
        """
        headers = {"idempotency-key": key or uuid.uuid4().hex}
        content = {"sequence": sequence, "bench": bench, **more}
        return self._until_answered(
            lambda: self._post("queue", content, query={"held": held}, headers=headers, limit_s=CHECKED_WITHIN_S)
        )

    def check(self, sequence: str, bench: str, **more: Any) -> Json:
        """Check a submission without queueing it; return warnings and the problems that forbid a run."""
        return self._post("check", {"sequence": sequence, "bench": bench, **more}, limit_s=CHECKED_WITHIN_S)

    def hold(self, item: str, version: int | None = None) -> Json:
        """Hold a waiting item. `version` is that of the item which the caller has seen; None for any."""
        return self._change(item, "hold", version)

    def release(self, item: str, version: int | None = None) -> Json:
        """Release a held item."""
        return self._change(item, "release", version)

    def cancel(self, item: str, version: int | None = None) -> Json:
        """Cancel a waiting item."""
        return self._change(item, "cancel", version)

    def move(self, item: str, before: str | None = None, version: int | None = None) -> Json:
        """Move a waiting item before another one, or to the end."""
        return self._change(item, "move", version, before=before)

    def clone(self, item: str) -> Json:
        """Append an item with the submission of another one, and return it."""
        return self._post(f"queue/{_part(item)}/clone")

    def go_on(self, bench: str) -> None:
        """Let items begin at a bench again that has stopped."""
        self._call("POST", f"benches/{_part(bench)}/go-on")

    def wait(self, item: str, *, limit_s: float | None = None, seen: Callable[[Json], object] = lambda _: None) -> Json:
        """Wait until an item has ended, was refused or cancelled, and return it; `seen` is called after each look.

        A station that is restarted meanwhile is waited for, for `self.limit_s`. Raises NoReply after `limit_s`.
        """
        watch = Stopwatch()
        while True:
            found = self._until_answered(lambda: self.item(item))
            seen(found)
            if found["state"] in FINAL:
                return found
            if limit_s is not None and watch.elapsed_s() >= limit_s:
                raise NoReply(f"item {found['number']} is still {found['state']} after {limit_s:g} s")
            _pause(AGAIN_EVERY_S)

    def runs(self, text: str = "", *, state: str = "", limit: int = 100, before: str = "") -> list[Json]:
        """Return runs, newest first; `text` is searched in names, titles, units and operators."""
        return self._list("runs", text=text, state=state, limit=limit, before=before)

    def run(self, run: str) -> Json:
        """Return a run by the name of its directory."""
        return self._get(f"runs/{_part(run)}")

    def live(self, run: str) -> Json:
        """Return the state of a run in progress."""
        return self._get(f"runs/{_part(run)}/live")

    def events(self, run: str, after: int = 0) -> Iterator[Json]:
        """Yield the entries of the journal of a run after a number, until it ends.

        A lost stream is continued behind the last entry. Raises NoStation and NoReply when none could be opened for
        `self.limit_s`.
        """
        lost: Stopwatch | None = None
        while True:
            try:
                for kind, entry in self._stream(run, after):
                    lost = None
                    if kind == "end":
                        return
                    if kind != OPENED:
                        yield entry
                        after = int(entry["seq"])
            except (NoStation, NoReply):
                lost = lost or Stopwatch()
                if lost.elapsed_s() >= self.limit_s:
                    raise
            _pause(AGAIN_EVERY_S)

    def pause(self, run: str) -> str:
        """Pause a run before its next step; return the answer of the run."""
        return self._command(run, "pause")

    def resume(self, run: str) -> str:
        """Continue a paused run."""
        return self._command(run, "resume")

    def skip(self, run: str) -> str:
        """Interrupt the current step and continue with the next one."""
        return self._command(run, "skip")

    def repeat(self, run: str) -> str:
        """Restart the current step or, while paused, repeat the previous one."""
        return self._command(run, "repeat")

    def stop(self, run: str, *, after_step: bool = False) -> str:
        """Interrupt the current step, or complete it; then the teardown runs."""
        return self._command(run, "stop", when="after_step" if after_step else "now")

    def abort(self, run: str) -> str:
        """End a run at once: no teardown, all devices are made safe."""
        return self._command(run, "abort")

    def answer(self, run: str, answer: str, step: str | None = None) -> str:
        """Answer a question of a run; `step` is needed if several are open."""
        return self._command(run, "answer", {"answer": answer, "step": step})

    def instruments(self, bench: str) -> Json:
        """Return the instruments of a bench: identities, calibrations, last errors, and who holds it."""
        return self._get(f"benches/{_part(bench)}/instruments")

    def calibrations(self, within_days: int | None = None) -> list[Json]:
        """Return the calibrations of all benches, the next one due first."""
        return self._list("calibrations", **({} if within_days is None else {"within_days": within_days}))

    def control(self, bench: str, *, key: str = "", **session: Any) -> Json:
        """Queue a session of manual control, and return its item; `session` may have `units`, `silence`, `order`."""
        headers = {"idempotency-key": key or uuid.uuid4().hex}
        path = f"benches/{_part(bench)}/manual"
        return self._until_answered(lambda: self._post(path, session, headers=headers, limit_s=CHECKED_WITHIN_S))

    def order(self, run: str, **step: str) -> str:
        """Begin an order of manual control, a step such as `move="head", to="90 °"`; return its id in the journal."""
        return self._command(run, "orders", {"order": step})

    def halt(self, run: str, device: str) -> str:
        """Interrupt the order under way to a device, and stop what it has started."""
        return self._command(run, "orders/halt", {"device": device})

    def alive(self, run: str) -> Json:
        """Give a sign of life to a session of manual control; return its state."""
        return self._post(f"runs/{_part(run)}/orders/alive")

    def finish(self, run: str) -> str:
        """End a session of manual control; everything is made safe."""
        return self._command(run, "orders/finish")

    def users(self) -> list[Json]:
        """Return all users with their roles."""
        return self._list("users")

    def set_user(self, name: str, role: str, password: str) -> None:
        """Create a user, or change role and password."""
        self._call("PUT", f"users/{_part(name)}", {"role": role, "password": password})

    def remove_user(self, name: str) -> None:
        """Remove a user with all sessions and tokens."""
        self._call("DELETE", f"users/{_part(name)}")

    def tokens(self) -> list[Json]:
        """Return all tokens without their secrets."""
        return self._list("tokens")

    def new_token(self, label: str, scopes: list[str], days: int = 90) -> str:
        """Return the secret of a new token, which cannot be read again."""
        return str(self._call("POST", "tokens", {"label": label, "scopes": scopes, "days": days})["token"])

    def revoke(self, token: str) -> None:
        """Revoke a token by its id."""
        self._call("DELETE", f"tokens/{_part(token)}")

    def _change(self, item: str, change: str, version: int | None, **more: Any) -> Json:
        return self._post(f"queue/{_part(item)}/{change}", {"version": version, **more})

    def _command(self, run: str, command: str, content: Any = None, **query: str) -> str:
        return str(self._call("POST", f"runs/{_part(run)}/{command}", content, query=query)["answer"])

    def _stream(self, run: str, after: int) -> Iterator[tuple[str, Json]]:
        target, headers = f"/api/v1/runs/{_part(run)}/events", {"last-event-id": str(after)}
        with self._http.opened("GET", target, None, headers, SILENT_LIMIT_S) as (answer, _):
            yield OPENED, {}
            for event in server_events(iter(lambda: answer.readline(LINE_LIMIT_BYTES), b"")):
                yield event.kind, _entry(event.data)

    def _until_answered(self, call: Callable[[], Json]) -> Json:
        """Return the result of a call that may be repeated, once a station answers, within `limit_s`."""
        watch = Stopwatch()
        while True:
            try:
                return call()
            except (NoStation, NoReply):
                if watch.elapsed_s() >= self.limit_s:
                    raise
            _pause(AGAIN_EVERY_S)

    def _get(self, path: str) -> Json:
        found: Json = self._call("GET", path)
        return found

    def _list(self, path: str, **query: Any) -> list[Json]:
        found: list[Json] = self._call("GET", path, query=query)
        return found

    def _post(self, path: str, content: Any = None, **more: Any) -> Json:
        found: Json = self._call("POST", path, content, **more)
        return found

    def _call(
        self, method: str, path: str, content: Any = None, *, query: Mapping[str, Any] | None = None,
        headers: Mapping[str, str] | None = None, limit_s: float | None = None,
    ) -> Any:  # fmt: skip
        return self._http.call(method, path, content, limit_s=limit_s or self.limit_s, query=query, headers=headers)


def _entry(text: str) -> Json:
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise BenchError("the stream of events is not that of a station")
    return found


def _part(name: str) -> str:
    """Return a name as one part of a path. Raises InputError."""
    if name in ("", ".", ".."):
        raise InputError(f"'{name}' is not a name")
    return quote(name, safe="")

"""Core of the guardian: detects the death or silence of the run's process. Imports only the standard library.

Silence is counted in ticks of this process: on a suspended or overloaded computer the guardian does not tick either, so
that no run is declared dead. The counters in beats are compared per beat: without beats no counter is late.
"""

from __future__ import annotations

import json
import select
import signal
import socket
import time  # noqa: TID251  the core runs without the loop and imports nothing of the program
from collections.abc import Callable, Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any, NamedTuple

TICK_S = 0.25
BEAT_S = 0.5
LEASE_S = 10.0  # silence after which the process of the run is killed
COMMIT_S = 30.0  # permitted time for data to wait for the disk
DIE_WITHIN_S = 5.0
LONGEST = 4096  # bytes of a message

ARMED, CANNOT, BEAT, OVER = b"armed", b"cannot ", b"beat ", b"over "


class Lost(NamedTuple):
    """Reason why the bench must be made safe, and whether chambers may be held, from the last beat."""

    why: str
    may_hold: bool = False


class Over(NamedTuple):
    """Result of a run that has made its bench safe: safe roles, and chambers held at their set point."""

    safe: tuple[str, ...] = ()
    held: tuple[str, ...] = ()


def beat(turns: int, commits: int, polls: Mapping[str, int], *, waits: bool, may_hold: bool) -> bytes:
    """Encode a beat: turns of the loop, commits, whether data wait for the disk, polls by role."""
    content = {"turns": turns, "commits": commits, "waits": waits, "polls": dict(polls), "may_hold": may_hold}
    return BEAT + json.dumps(content).encode()


def over(end: Over) -> bytes:
    """Encode the message with which a run dismisses its guardian."""
    return OVER + json.dumps(end._asdict()).encode()


class Counters:
    """Time for which the counters in the beats have not advanced.

    `alarm` is called once for each late counter. `stuck` is the reason to kill the run, or "".
    """

    def __init__(self, polls_within_s: Mapping[str, float], alarm: Callable[[str], object]) -> None:
        self._limits_s, self._alarm = polls_within_s, alarm
        self._last: dict[str, Any] = {}
        self._standing_s: dict[str, float] = {}
        self._alarmed: set[str] = set()
        self.turns, self.may_hold, self.stuck = -1, False, ""

    def take(self, message: bytes) -> bool:
        """Process a message; return True if it is a beat and the loop has turned since the last one."""
        content = _content(message, BEAT)
        turns, polls = content.get("turns"), content.get("polls")
        if not isinstance(turns, int) or turns == self.turns or not isinstance(polls, dict):
            return False
        self.turns, self.may_hold = turns, content.get("may_hold") is True
        counts = {role: polls.get(role) for role in self._limits_s}  # None: not polled, or no longer
        counts["commits of the record"] = content.get("commits") if content.get("waits") is True else None
        for name, count in counts.items():
            stands = count is not None and count == self._last.get(name)
            self._standing_s[name] = self._standing_s[name] + BEAT_S if stands else 0.0
        self._last = counts
        self._judge()
        return True

    def _judge(self) -> None:
        for name, standing_s in self._standing_s.items():
            limit_s = self._limits_s.get(name)
            late = standing_s > (COMMIT_S if limit_s is None else limit_s)
            if late and name not in self._alarmed:
                self._alarmed.add(name)
                what = "nothing was committed to the disk" if limit_s is None else f"{name} was not polled"
                self._alarm(f"{what} for {standing_s:g} s, while the event loop of the run is running")
            if limit_s is not None and standing_s > 2 * limit_s:
                self.stuck = f"{name} was not polled for {standing_s:g} s; the process of the run was killed"


def watch(
    link: socket.socket, runner: int, lease_s: float = LEASE_S,
    polls_within_s: Mapping[str, float] = MappingProxyType({}), alarm: Callable[[str], object] = lambda _text: None,
) -> Lost | Over:  # fmt: skip
    """Wait until the bench must be made safe, and return the reason; or return its state when the run has ended.

    `link` receives messages of the run. `runner` is the pidfd of its process, which is killed after `lease_s` without a
    beat, or if an instrument was not polled for twice its time in `polls_within_s`, by role. `alarm` receives
    descriptions of late counters and must return at once.
    """
    counters, silent_s, looked_s = Counters(polls_within_s, alarm), 0.0, time.monotonic()
    while silent_s < lease_s and not counters.stuck:
        ready, _, _ = select.select([link.fileno(), runner], [], [], TICK_S)
        tick_s, looked_s = min(TICK_S, time.monotonic() - looked_s), time.monotonic()
        if link.fileno() in ready:
            message = _received(link)
            if message.startswith(OVER):
                return _left(message)
            if not message:
                return Lost(_gone(runner), counters.may_hold)
            silent_s = 0.0 if counters.take(message) else silent_s + tick_s
        elif runner in ready:
            return Lost("the process of the run has died", counters.may_hold)
        else:
            silent_s += tick_s
    with suppress(ProcessLookupError):
        signal.pidfd_send_signal(runner, signal.SIGKILL)
    dead, _, _ = select.select([runner], [], [], DIE_WITHIN_S)
    was = counters.stuck or f"the process of the run did not respond for {lease_s:g} s and was killed"
    return Lost(was if dead else f"{was}, but does not end: it may still send commands", counters.may_hold)


def _left(message: bytes) -> Over:
    content = _content(message, OVER)
    return Over(*(tuple(content.get(key) or ()) for key in Over._fields))


def _content(message: bytes, kind: bytes) -> dict[str, Any]:
    """Return the content of a message of this kind; empty if it is of another kind or cannot be decoded."""
    with suppress(ValueError, RecursionError):
        if message.startswith(kind) and isinstance(content := json.loads(message[len(kind) :]), dict):
            return content
    return {}


def _received(link: socket.socket) -> bytes:
    try:
        return link.recv(LONGEST)
    except OSError:
        return b""


def _gone(runner: int) -> str:
    """Return the reason why the link is closed; the kernel closes it some time before the process has ended."""
    ended, _, _ = select.select([runner], [], [], DIE_WITHIN_S)
    return (
        "the process of the run has died"
        if ended
        else "the run has closed the link to its guardian, and its process goes on"
    )

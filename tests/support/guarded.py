"""The demonstration bench at addresses where nothing is, and instruments that stand for its own."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import pytest

from bench.config.bench import load_bench
from bench.config.models import BenchFile
from drivers.errors import NoAnswer
from drivers.values import ChamberState, Identity, Reading, SourceReading
from tests.support.runs import copy_bench

_FIRST = 2000 + os.getpid() % 7_990  # other tests on this machine hold other ports
_ADDRESSES = {
    f"sim+tcp://127.0.0.1:{port}": f"tcp://10.0.0.1:{first + _FIRST}"
    for port, first in ((1502, 20_000), (8000, 30_000), (5025, 40_000))
}
HELD = ("    safe: {temperature: 25 °C}", "    safe: {temperature: 25 °C, hold: 30 min}")


def bench_file(folder: Path, more: str = "") -> Path:
    """The demonstration bench at addresses where nothing is; its chamber may be held for 30 min."""
    path = copy_bench(folder / "config", HELD, *_ADDRESSES.items(), ("sim+serial:///tmp", f"serial://{folder}"))
    with path.open("a", encoding="utf-8") as file:
        file.write(more)
    return path


def guarded(folder: Path, more: str = "") -> BenchFile:
    """The bench as it is loaded."""
    return load_bench(bench_file(folder, more)).bench


def at(air_c: float, set_point_c: float, target_c: float | None = None) -> ChamberState:
    """State of a chamber; without a target, of one that does not ramp."""
    return ChamberState(air_c, set_point_c, set_point_c if target_c is None else target_c, None)


class _Instrument:
    """What every instrument does: `calls` are in order; one that `is_silent` gives no answer."""

    def __init__(self, name: str) -> None:
        self.name, self.calls, self.is_silent = name, list[str](), False

    async def __aenter__(self) -> Self:
        self._called("enter")
        return self

    async def __aexit__(self, *_exc: object) -> None:
        self.calls.append("exit")

    async def identify(self) -> Identity:
        self._called("identify")
        return Identity()

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        return {}

    def _called(self, what: str) -> None:
        self.calls.append(what)
        if self.is_silent:
            raise NoAnswer(self.name, "does not answer")


class FakeChamber(_Instrument):
    """A chamber in a state, whose set point is the safe one when it was made safe."""

    def __init__(self, state: ChamberState, name: str = "chamber", safe_c: float = 25.0) -> None:
        super().__init__(name)
        self.now, self.safe_c, self.hangs = state, safe_c, False

    async def state(self) -> ChamberState:
        self._called("state")
        return self.now

    async def hold(self) -> None:
        self._called("hold")

    async def ramp_to(self, temperature_c: float, rate_c_per_min: float) -> None:
        self._called("ramp")

    async def make_safe(self) -> None:
        self._called("make_safe")
        if self.hangs:
            await asyncio.sleep(3600)
        self.now = self.now._replace(set_point_c=self.safe_c, target_c=self.safe_c)


class FakeSupply(_Instrument):
    """A supply whose output is on."""

    def __init__(self, name: str = "supply") -> None:
        super().__init__(name)
        self.output = True

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        self._called("set")

    async def read(self) -> SourceReading:
        self._called("read")
        return SourceReading(0.0, 0.0, self.output)

    async def make_safe(self) -> None:
        self._called("make_safe")
        self.output = False


class FakeAxis(_Instrument):
    """A head or a table."""

    async def make_safe(self) -> None:
        self._called("make_safe")


def does(device: Any, name: str, act: Callable[[int], Any], monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Let a method of a device act by the number of its call; return the calls."""
    calls: list[int] = []

    async def acts(*_arguments: object) -> Any:
        calls.append(len(calls))
        found = act(calls[-1])
        return await found if asyncio.iscoroutine(found) else found

    owner = type(device) if name.startswith("__") else device
    monkeypatch.setattr(owner, name, acts)
    return calls


def raises(*problems: BaseException | None) -> Callable[[int], None]:
    """Raise one after the other, then the last one."""

    def act(count: int) -> None:
        if (problem := problems[min(count, len(problems) - 1)]) is not None:
            raise problem

    return act


def forever(_count: int) -> Any:
    """Not end."""
    return asyncio.sleep(1e6)


class Ends:
    """The request to end, which notes for how long it was waited for instead of waiting."""

    def __init__(self, then: Callable[[int], object] = lambda _count: None) -> None:
        self.waits: list[float] = []
        self._then, self._is_set = then, False

    def wait(self, limit_s: float) -> None:
        self.waits.append(limit_s)
        self._then(len(self.waits))

    def set(self) -> None:
        self._is_set = True

    def is_set(self) -> bool:
        return self._is_set

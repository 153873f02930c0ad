"""Commands of manual control that a run accepts over its control socket."""

from __future__ import annotations

import json
from collections.abc import Callable

from bench.engine.journal import Journal
from bench.engine.manual import Manual
from bench.errors import InputError
from bench.runner.commands import durable, recorded
from bench.runner.control import Arguments, Handlers


def orders_of(manual: Manual, journal: Journal, notice: Callable[[str], None]) -> Handlers:
    """Return the handlers of orders by name; each is in the journal with its sender, but for signs of life."""

    async def order(request: Arguments) -> str:
        begun = manual.order(_given(request, "order"), request["by"])
        notice(f"{begun} by {request['by']}: {request['order']}")
        await durable(journal, f"{begun} begins; this is not recorded on the disk")
        return begun

    def halt(request: Arguments) -> str:
        return f"halted: {manual.halt(_given(request, 'device'))}"

    def finish(_: Arguments) -> str:
        manual.finish()
        return "the session ends, and everything is made safe"

    async def alive(_: Arguments) -> str:
        manual.heard()
        return json.dumps(manual.to_json())

    acts = {act.__name__: recorded(act, journal, notice) for act in (halt, finish)}
    return {"order": order, **acts, "alive": alive}


def _given(request: Arguments, name: str) -> str:
    if not request.get(name):
        raise InputError(f"'{name}' is missing")
    return request[name]

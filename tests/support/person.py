"""Somebody at a simulated head that is turned by hand, and what drivers for it are made from."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.operator_head.description import DESCRIPTION, OperatorHeadLimits
from drivers.person import OperatorAnswer, OperatorRequest
from drivers.transport.address import Address
from drivers.transport.wires import RealWires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.operator_head import HandTurnedHead
from simulators.units.settings import WorldSettings
from simulators.world import World

LIMITS = {"angle": {"min": "-5°", "max": "365°"}}


class Somebody:
    """Does what he is asked after `usual_s`, and types what he was asked for.

    `answers` are what he types instead, one after the other. `withdrawn` counts the questions that had no answer.
    """

    def __init__(self, head: HandTurnedHead) -> None:
        self._head = head
        self.requests: list[OperatorRequest] = []
        self.answers: list[float] = []
        self.withdrawn = 0
        self.is_there = True

    async def prompt(self, request: OperatorRequest) -> OperatorAnswer:
        self.requests.append(request)
        try:
            await (asyncio.sleep(request.usual_s) if self.is_there else asyncio.Event().wait())
        except asyncio.CancelledError:
            self.withdrawn += 1
            raise
        if request.turn is not None:
            self._head.turn(request.turn)
        shown_deg = request.turn.angle_deg if request.turn is not None else self._head.shown_deg
        return OperatorAnswer(self.answers.pop(0) if self.answers else shown_deg, "A. Person")

    @property
    def told(self) -> list[str]:
        return [request.text for request in self.requests]


class ByHand:
    """A simulated head that is turned by hand, with somebody beside it."""

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.head = HandTurnedHead(self.world, self.faults)
        self.person = Somebody(self.head)
        self.notes: list[str] = []

    def driver(self, **options: Any) -> Any:
        setup = Setup(
            name="head", address=Address.parse("person:operator"), wires=RealWires(),
            options=DESCRIPTION.options.model_validate({"turn_time": "2 min"} | options),
            limits=OperatorHeadLimits.model_validate(LIMITS), safe=Nothing(),
            identity=IdentityPin(maker="Moore", model="1440", serial="M-77"), note=self.notes.append,
            person=self.person,
        )  # fmt: skip
        return make_driver(DESCRIPTION, setup)

    def heard(self) -> int:
        return len(self.person.requests)

    def moves(self) -> list[float]:
        return [request.turn.angle_deg for request in self.person.requests if request.turn is not None]

    @property
    def angle_deg(self) -> float:
        return self.head.shown_deg


def by_hand(use: Callable[[ByHand, Any], Awaitable[None]], **options: Any) -> None:
    async def main() -> None:
        bench = ByHand()
        async with bench.driver(**options) as driver:
            await use(bench, driver)

    run(main(), AS_FAST_AS_POSSIBLE)

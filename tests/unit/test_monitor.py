"""When the monitor asks whom."""

from __future__ import annotations

import asyncio
from pathlib import Path

from bench.config.bench import load_bench
from bench.engine.interlocks import Interlocks
from bench.engine.monitor import Monitor
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.rig import Rig
from bench.store.writer import RunWriter

BENCH = load_bench(Path(__file__).parents[2] / "config/simulated.yaml").bench
EVERY_S = 10.0  # what is no named reading


class Noted:
    """A device that keeps when it was asked, and answers so much later."""

    def __init__(self, *answers_s: float) -> None:
        self.asked_s: list[float] = []
        self._answers_s = list(answers_s)

    async def poll(self) -> dict[str, list[object]]:
        self.asked_s.append(asyncio.get_running_loop().time())
        await asyncio.sleep(self._answers_s.pop(0) if self._answers_s else 0.0)
        return {}


def watched(folder: Path, duration_s: float, **devices: Noted) -> None:
    writer = RunWriter(folder)

    async def main() -> None:
        monitor = Monitor(Rig(devices), BENCH, Interlocks({}, BENCH), writer, lambda *_: None)
        monitor.start()
        await asyncio.sleep(duration_s)
        await monitor.stop()

    try:
        run(main(), AS_FAST_AS_POSSIBLE)
    finally:
        writer.close()


def test_all_are_asked_at_once_and_then_one_after_the_other_each_once_a_period(tmp_path):
    chamber, head, supply, source = devices = [Noted() for _ in range(4)]
    watched(tmp_path, 24.0, chamber=chamber, head=head, supply=supply, source=source)
    assert [device.asked_s for device in devices] == [
        [0.0, 2.5, 12.5, 22.5], [0.0, 5.0, 15.0], [0.0, 7.5, 17.5], [0.0, 10.0, 20.0],
    ]  # fmt: skip


def test_who_answers_late_is_asked_at_once_and_then_again_once_a_period(tmp_path):
    chamber = Noted(0.0, 13.0)
    watched(tmp_path, 50.0, chamber=chamber)
    assert chamber.asked_s == [0.0, EVERY_S, 23.0, 33.0, 43.0]

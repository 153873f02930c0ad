"""A share of an hour of a night by OpenHTF with plugs that simulate, its sleeps faked; the record is JSON at the end.

SHARE MOVES WAITS READINGS: the moves of an axis, waits, and readings of six channels at 100 Hz of an hour, times
SHARE. Each move with what follows is a phase; its readings are one measurement with the dimensions time and channel.
"""

import json
import sys

import openhtf as htf
from openhtf.plugs import BasePlug
from openhtf_run import executed

CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")


class Bench(BasePlug):
    """An axis, a counter, and a clock that jumps."""

    def __init__(self) -> None:
        self.now_s, self.angle_deg, self.counts = 0.0, 0.0, [0] * len(CHANNELS)

    def move(self, to_deg: float) -> None:
        """Be there."""
        self.now_s += abs(to_deg - self.angle_deg) / 30.0
        self.angle_deg = to_deg

    def wait(self, seconds: float) -> None:
        """Let virtual time pass."""
        self.now_s += seconds

    def read(self) -> list[int]:
        """The counts after another 10 ms."""
        self.now_s += 0.01
        self.counts = [(count + 1113) & 0xFFFFFF for count in self.counts]
        return self.counts


def phase(number: int, waits: int, readings: int) -> htf.PhaseDescriptor:
    """A move, waits, and an acquisition."""

    @htf.PhaseOptions(name=f"attitude_{number}")
    @htf.measures(htf.Measurement(f"counts_{number}").with_dimensions("s", "channel"))
    @htf.plug(bench=Bench)
    def attitude(test: htf.TestApi, bench: Bench) -> None:
        bench.move(float(number % 7))
        for _ in range(waits):
            bench.wait(5.0)
        counts = test.measurements[f"counts_{number}"]
        for _ in range(readings):
            values = bench.read()
            for channel, value in zip(CHANNELS, values, strict=True):
                counts[bench.now_s, channel] = value

    return attitude


def parts(total: int, count: int) -> list[int]:
    """`total` in so many nearly equal parts."""
    return [total * (number + 1) // count - total * number // count for number in range(count)]


share = float(sys.argv[1])
moves, waits, readings = (max(1, round(float(each) * share)) for each in sys.argv[2:5])
phases = [phase(*each) for each in zip(range(moves), parts(waits, moves), parts(readings, moves), strict=True)]
took_s = executed(phases, "night")
print(json.dumps({"s_per_hour": took_s / share, "readings": readings}))

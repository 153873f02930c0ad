"""What viewers of a run cost its station: `python -m benchmarks.station_viewers [--viewers 5] [--seconds 60]`.

Each viewer does what the page of a bench does: it reads the stream of parts, asks for six curves every 2 s and for open
alerts every 10 s. Printed are the processor time of the station with and without them, as a share of one core, and how
long a reading that is on the disk takes to the stream.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx

from bench.store.tail import Tail
from tests.support.station import Served, serving

CHANNELS = (
    "chamber.process_value", "chamber.set_point", "unit_temperature", "head.angle", "counter.x", "counter.x.deviation",
)  # fmt: skip
CURVES_EVERY_S, ALERTS_EVERY_S = 2.0, 10.0
LOOKED_AT = "chamber.process_value"
TICKS = os.sysconf("SC_CLK_TCK")


def processor_s(process: int) -> float:
    """Processor time of a process so far, in s."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


class Viewer(threading.Thread):
    """Page of a bench, until `over`."""

    def __init__(self, station: Served, run: str) -> None:
        super().__init__(daemon=True)
        headers = {"authorization": station.client.headers["authorization"]}
        self._client = httpx.Client(base_url=station.url, headers=headers, timeout=30)
        self._run, self.over = run, threading.Event()

    def run(self) -> None:
        threading.Thread(target=self._curves, daemon=True).start()
        with self._client.stream("GET", f"/benches/demo/live?run={self._run}") as stream:
            for _ in stream.iter_raw():
                if self.over.is_set():
                    return

    def _curves(self) -> None:
        query: dict[str, object] = {"channel": CHANNELS, "points": 600, "last": 900}
        for number in range(10**6):
            answer = self._client.get(f"/api/v1/runs/{self._run}/series", params=query)
            if answer.status_code == httpx.codes.OK:  # one token's requests at once are limited
                found = answer.json()
                since_s = max(0.0, found["until_s"] - 2 * found["width_s"])
                query = {"channel": CHANNELS, "since": since_s, "width": found["width_s"]}
            if number % round(ALERTS_EVERY_S / CURVES_EVERY_S) == 0:
                self._client.get("/alerts/open", headers={"bench-poll": "true"})
            if self.over.wait(CURVES_EVERY_S):
                return


def share(station: Served, seconds: float) -> float:
    """Processor time of a station over a while, as a share of one core."""
    before = processor_s(station.process.pid)
    time.sleep(seconds)
    return (processor_s(station.process.pid) - before) / seconds


def delays_s(station: Served, run: Path, count: int) -> list[float]:
    """How long readings that are on the disk take to the stream, in s."""
    found: list[float] = []
    with station.client.stream("GET", f"/benches/demo/live?run={run.name}") as stream:
        text, lines = "", stream.iter_lines()
        for _ in range(count):
            seq, _ = newest(run)
            while newest(run)[0] == seq:
                time.sleep(0.02)
            begun, (_, shown) = time.monotonic(), newest(run)
            while f"{shown:.2f}" not in text:
                text = next(lines)
            found.append(time.monotonic() - begun)
    return found


def newest(run: Path) -> tuple[int, float]:
    """Number and value of the newest reading of a channel."""
    with Tail(run) as tail:
        readings = [each for each in tail.readings(max(0, tail.last_reading() - 200)) if each.channel == LOOKED_AT]
    return readings[-1].seq, readings[-1].value


@contextmanager
def running() -> Iterator[tuple[Served, Path]]:
    """A station, and the folder of a run on it that lasts for hours."""
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as station:
        item = station.submit(units={"a": "QF-1"}, speed="1", settings={"soak": "4 h"})
        run = station.until(lambda: station.get(f"queue/{item['id']}")["run"], 60)
        time.sleep(15)  # the plan is read, and what is made ahead is made
        yield station, Path(folder) / "runs" / run
        station.post(f"runs/{run}/abort")
        station.ended(item)


def shares(counts: Sequence[int], seconds: float, delays: list[float] | None = None) -> list[float]:
    """Processor time of a station with so many viewers, as shares of one core; `delays` gets the last ones, in s."""
    found, viewers = [], list[Viewer]()
    with running() as (station, run):
        for count in sorted(counts):
            added = [Viewer(station, run.name) for _ in range(count - len(viewers))]
            for each in added:
                each.start()
                time.sleep(CURVES_EVERY_S / len(added))
            viewers += added
            time.sleep(5 if added else 0)
            found.append(share(station, seconds))
        if delays is not None:
            delays += delays_s(station, run, 10)
        for each in viewers:
            each.over.set()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--viewers", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    delays = list[float]()
    alone, together = shares((0, asked.viewers), asked.seconds, delays)
    print(f"alone {alone:.1%} of a core, with {asked.viewers} viewers {together:.1%}: they cost {together - alone:.1%}")
    print(
        f"a reading on the disk is on the stream after {statistics.median(delays):.2f} s, at most {max(delays):.2f} s"
    )


if __name__ == "__main__":
    main()

"""A saturated CAN bus: bytes to stored frames and counts, beside python-can and cantools, from one sender.

Processor time a frame is that of the reading process alone, from before the bus is opened until all counts are there.
It includes the 0.02 s of a run that reads nothing, a tenth of the slice by socketcand. The bus is full: 8,000 frames/s
are 1 Mbit/s. Overnight, the rate is doubled until a frame is lost or a core is full.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cantools

from benchmarks.bus import DBC, frames, log_of, sending
from benchmarks.compared import Row, Side, in_turn
from drivers.can.dbc import Dbc
from drivers.can.frame_block import FrameBlock

SATURATED = 8000.0  # frames/s
LEAD_S = 2.5  # for which the bus sends longer than it is read
PEER = Path(__file__).parents[1] / "peers" / "python_can_ingest.py"
ADDRESSES = {"slcan": "slcan://{}?bitrate=1000000", "socketcand": "socketcand://{}/can0", "log": "log://{}"}
OURS, THEIRS = "this program", "python-can with cantools"
KEPT = {
    OURS: "SQLite, synchronous=FULL, within 1 s",
    THEIRS: "SQLite, synchronous=FULL, within 5 s or 500 frames",
}  # fmt: skip
WHOLE_S, LOG_S, HELD_S = 60.0, 20.0, 3.0
SLICES_S = {"slcan": 3.0, "socketcand": 10.0, "log": LOG_S}
ENOUGH = 0.97  # of the frames that are sent in the time; the rest is in the buffers of a bus that is read late
GOAL = 10.0
RATES = tuple(SATURATED / 8 * 2**n for n in range(8))


def measure(whole: bool) -> Iterator[Row]:
    """Each link at a full bus, then the rates that are held, then the decoders alone."""
    with tempfile.TemporaryDirectory() as name:
        log = Path(name) / "bus.log"
        log.write_bytes(log_of(frames(SATURATED, int(SATURATED * (LOG_S + 0.2)))))
        for link in ADDRESSES:
            yield _full_bus(link, log, WHOLE_S if whole and link != "log" else SLICES_S[link])
    for link in ("slcan", "socketcand") if whole else ():
        yield _highest_rate(link)
    yield _decoders()


def _full_bus(link: str, log: Path, seconds: float) -> Row:
    lost: dict[str, list[float]] = {OURS: [], THEIRS: []}

    def cost_us(who: str) -> float:
        found = read(who, link, SATURATED, seconds, log)
        is_whole = _is_held(found, SATURATED, seconds)
        lost[who].append(0.0 if is_whole else max(1 / SATURATED, 1 - found["frames"] / (SATURATED * seconds)))
        return float(found["cpu_s"]) / found["frames"] * 1e6

    values = in_turn({who: partial(cost_us, who) for who in (OURS, THEIRS)})
    sides = {who: Side(_named(who), f"{KEPT[who]}; {_lost(lost[who])}", values[who]) for who in values}
    row = Row(
        "P2", f"a full CAN bus, 8,000 frames/s, {seconds:g} s by {link}: stored and decoded", "µs of processor/frame",
        sides[OURS], (sides[THEIRS],), _limit(link, seconds), f"≤ 1/{GOAL:g}, none lost", False,
    )  # fmt: skip
    is_met = row.ratio(row.peers[0]) >= GOAL and not any(lost[OURS])
    return replace(row, is_met=is_met)


def _limit(link: str, seconds: float) -> str:
    """What asyncio takes to receive the same bytes from a server, with nothing done to them."""
    if link != "socketcand":
        return ""
    with sending(link, SATURATED, seconds + LEAD_S) as address:
        command = [sys.executable, "-m", "benchmarks.bare_receiver", address, f"{seconds}"]
        found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return f"only received by asyncio, each portion as it comes: {found['cpu_s'] / found['frames'] * 1e6:.2g} µs/frame"


def _lost(shares: list[float]) -> str:
    return f"{max(shares):.0%} lost" if any(shares) else "none lost"


def _named(who: str) -> str:
    if who == OURS:
        return f"inertial-test-bench {version('inertial-test-bench')}"
    return f"python-can {version('python-can')} with cantools {version('cantools')}"


def read(who: str, link: str, rate: float, seconds: float, log: Path | None = None) -> Mapping[str, Any]:
    """What one side printed that has read a link for some seconds."""
    with nullcontext(str(log)) if link == "log" else sending(link, rate, seconds + LEAD_S) as address:
        ours = ["-m", "benchmarks.ingest", ADDRESSES[link].format(address), f"{seconds}", f"{rate}"]
        theirs = [str(PEER), link, address, f"{seconds}", str(DBC)]
        command = [sys.executable, *(ours if who == OURS else theirs)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{who} at {rate:g} frames/s by {link}:\n{done.stderr}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def _is_held(found: Mapping[str, Any], rate: float, seconds: float) -> bool:
    whole = found["gaps"] == 0 and found["frames"] >= ENOUGH * rate * seconds
    return bool(whole and found["cpu_s"] < seconds)


def _highest_rate(link: str) -> Row:
    sides = {}
    for who in (OURS, THEIRS):
        held = 0.0
        for rate in RATES:
            try:
                found = read(who, link, rate, HELD_S)
            except RuntimeError:  # such as a bus that seems to have stopped
                break
            if not _is_held(found, rate, HELD_S):
                break
            held = rate
        sides[who] = Side(_named(who), KEPT[who], (held,))
    return Row(
        "P2", f"highest frame rate by {link} without frame loss (the rate is doubled up to it)", "frames/s",
        sides[OURS], (sides[THEIRS],), "", f"≥ {SATURATED:,.0f}", sides[OURS].value >= SATURATED, lower_is_better=False,
    )  # fmt: skip


def _decoders() -> Row:
    """Decoding alone, on the same frames in the same process."""
    text, count = DBC.read_text("utf-8"), 4000
    ours, theirs, block = Dbc(text), cantools.database.load_string(text, "dbc"), frames(SATURATED, count)
    rows = list(zip(block.ids.tolist(), [row.tobytes() for row in block.data], strict=True))

    def decode_theirs() -> None:
        for frame_id, payload in rows:
            theirs.decode_message(frame_id, payload, decode_choices=False, scaling=False)

    sides = {OURS: partial(_decode, ours, block), THEIRS: decode_theirs}
    values = in_turn({who: partial(_cost_us, work, count) for who, work in sides.items()}, 11)
    mine, peer = (
        Side(name, "nothing is stored", values[who])
        for who, name in ((OURS, _named(OURS)), (THEIRS, f"cantools {version('cantools')}"))
    )
    row = Row(
        "P2", f"decoding alone, {count} frames", "µs of processor/frame", mine, (peer,), "", f"≤ 1/{GOAL:g}", False
    )
    return replace(row, is_met=row.ratio(peer) >= GOAL)


def _decode(dbc: Dbc, block: FrameBlock) -> None:
    for message in dbc.messages.values():
        words = message.sent_in(block).words
        for signal in message.signals.values():
            signal.raw(words)


def _cost_us(work: Callable[[], None], count: int) -> float:
    began_s = time.process_time()
    work()
    return (time.process_time() - began_s) / count * 1e6

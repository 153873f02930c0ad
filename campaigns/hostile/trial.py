"""One document, given to everything that reads documents: what came of it, and how long it took."""

from __future__ import annotations

import re
import shutil
import signal
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench.config import layout
from bench.config.bench import load_bench
from bench.config.load import load_file
from bench.config.scenario import ScenarioFile
from bench.errors import InputError
from bench.sequence.load import load_judged_plan
from bench.sequence.plan.plan import Plan
from campaigns.hostile.corpus import ROOT
from campaigns.hostile.documents import Hostile
from campaigns.hostile.plans import NEIGHBOURS

LIMIT_S = 0.1
LAYOUT_LIMIT_S = 0.3  # reads a document twice, and scans it once more
LONG_PLAN_LIMIT_S = 2.0  # for a plan of as many steps as there may be, each with values of its own
MANY_STEPS = 1000
LONG_PLANS = ("plans.explosions", "plans.ranges", "plans.calls")
HANG_S = 10
ACCEPTED, REFUSED, HANG = "accepted", "refused", "hang"
# Read before anything is measured: what a process imports and makes once is no document's fault.
WARM_UP = (
    ROOT / "sequences/smoke.yaml",
    ROOT / "tests/broken/rule_too_few_angles.yaml",
    ROOT / "config/simulated.yaml",
)
_SHOWN = re.compile(r"[^\x00-\x08\x0a-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]*")


@dataclass(frozen=True)
class Reading:
    """One way of reading one document: `outcome` is ACCEPTED, REFUSED, or the unexpected result; `detail` has more."""

    index: int
    kind: str
    way: str
    outcome: str
    time_s: float
    detail: str = ""
    steps: int = 0  # of the plan, where there is one

    @property
    def is_offence(self) -> bool:
        """True if it went wrong, other than by its time."""
        return self.outcome not in (ACCEPTED, REFUSED)

    @property
    def place(self) -> str:
        """The file and line of the program where it went wrong; of a hang, which may be anywhere, none."""
        lines = [] if self.outcome == HANG else [line for line in self.detail.split("\n") if line.startswith("  File ")]
        return lines[-1] if lines else ""

    @property
    def is_long_plan(self) -> bool:
        """True if the document means many more steps than it says."""
        refused = re.search(r"has more than \d+ (steps|passes)", self.detail)
        return self.kind in LONG_PLANS or self.steps > MANY_STEPS or refused is not None

    @property
    def limit_s(self) -> float:
        """Time limit."""
        if self.is_long_plan and self.way != "bench":
            return LONG_PLAN_LIMIT_S
        return LAYOUT_LIMIT_S if self.way == "layout" else LIMIT_S

    @property
    def is_slow(self) -> bool:
        """True if it took too long."""
        return self.time_s > self.limit_s


class _Hang(BaseException):
    """Raised by an alarm, past every `except Exception`."""


class Readers:
    """The ways of reading a document that lies in `folder`, beside the files that others name."""

    def __init__(self, folder: Path) -> None:
        shutil.copytree(ROOT / "config", folder, dirs_exist_ok=True)
        for name, text in NEIGHBOURS.items():
            (folder / name).write_text(text, "utf-8")
        self._path = folder / "hostile.yaml"
        bench = load_bench(ROOT / "config/simulated.yaml").bench
        smoke = WARM_UP[0]
        self._ways: dict[str, Callable[[Path], object]] = {
            "sequence": lambda path: load_judged_plan(path, bench),
            "bench": load_bench,
            "scenario": lambda path: load_file(path, ScenarioFile),
            "parameters": lambda path: load_judged_plan(smoke, bench, parameters=path),
            "layout": lambda path: layout.changes([path]),
        }
        for path in WARM_UP:
            self.read(Hostile(0, "", path.read_bytes()))

    def read(self, document: Hostile) -> list[Reading]:
        """Read a document in each way, in some ways only every fourth, with its wall time."""
        self._path.write_bytes(document.data)
        usual = list(self._ways) if document.index % 4 == 0 else ["sequence", "bench"]
        return [self._one(document, way, time.perf_counter) for way in usual]

    def read_again(self, document: Hostile, way: str) -> Reading:
        """The same for one way, its time that of the processor, which other programs do not lengthen by waiting."""
        self._path.write_bytes(document.data)
        return self._one(document, way, time.process_time)

    def _one(self, document: Hostile, way: str, clock: Callable[[], float]) -> Reading:
        signal.signal(signal.SIGALRM, _hang)
        signal.setitimer(signal.ITIMER_REAL, HANG_S)
        outcome, detail, made = ACCEPTED, "", None
        began_s = clock()
        try:
            made = self._ways[way](self._path)
        except InputError as error:
            outcome, detail = REFUSED, str(error)
        except _Hang:
            outcome, detail = HANG, _last_lines()
        except BaseException as error:  # noqa: BLE001 all that is not ours is what is looked for
            outcome, detail = type(error).__name__, _last_lines()
        took_s = clock() - began_s
        signal.setitimer(signal.ITIMER_REAL, 0)
        if outcome == REFUSED and (odd := _odd(detail)):
            outcome, detail = odd, detail[:500]
        steps = len(made) if isinstance(made, Plan) else 0
        return Reading(document.index, document.kind, way, outcome, took_s, detail, steps)


def _odd(message: str) -> str:
    """Problems in the text of a refusal, which must not pass control characters to a terminal."""
    if not message:
        return "no words"
    return "" if all(_SHOWN.fullmatch(line) for line in message.split("\n")) else "unprintable words"


def _last_lines() -> str:
    return "".join(traceback.format_exc(limit=-4)[-2000:])


def _hang(*_: object) -> None:
    raise _Hang

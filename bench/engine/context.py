"""What a step of a plan acts with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.config.models import BenchFile
from bench.engine.crediting import SoakCredit
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.engine.numbered import Numbered
from bench.engine.questions import Desk
from bench.rig import Rig
from bench.store.writer import RunWriter

Found = Mapping[str, Any]  # what a step found, for the journal


@dataclass(frozen=True)
class Bench:
    """What a step acts with. `angles_deg` are where the last moves went, by role; `numbered` is what sends numbers.

    `credit` is that of a soak of a resumed run, `role` the one that a plug-in's step names.
    """

    file: BenchFile
    rig: Rig
    monitor: Monitor
    writer: RunWriter
    journal: Journal
    desk: Desk
    notice: Callable[[str], None]
    numbered: Numbered
    angles_deg: dict[str, float] = field(default_factory=dict)
    credit: SoakCredit | None = None
    role: str | None = None

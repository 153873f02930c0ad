"""Context in which a step of a plan acts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.config.models import BenchFile
from bench.engine.crediting import SoakCredit
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.engine.numbered import Numbered
from bench.engine.questions import PromptQueue
from bench.rig import Rig
from bench.store.writer import RunWriter

Found = Mapping[str, Any]  # result of a step, for the journal


@dataclass(frozen=True)
class Bench:
    """Context of a step: rig, plan and services.

    `angles_deg` are the targets of the last moves by role, `numbered` are the devices that number their frames,
    `credit` is that of a soak of a resumed run, `role` is the one that a plug-in's step names.
    """

    file: BenchFile
    rig: Rig
    monitor: Monitor
    journal: Journal
    prompts: PromptQueue
    notice: Callable[[str], None]
    numbered: Numbered
    angles_deg: dict[str, float] = field(default_factory=dict)
    credit: SoakCredit | None = None
    role: str | None = None

    @property
    def writer(self) -> RunWriter:
        """Writer of the record of the run."""
        return self.journal.writer

"""Health of a station: its parts, the disk and the clock."""

from __future__ import annotations

import shutil
import subprocess
from datetime import datetime
from pathlib import Path

from pydantic import BaseModel, Field

from bench.clock import wall_utc
from bench.station.daemon import Daemon

CLOCK_ANSWERS_S = 5.0


class PartView(BaseModel):
    """Part of the station."""

    name: str
    works: bool = Field(description="it looks within its time, and the last time without a problem")
    problem: str
    looked_s: float = Field(description="time since its last look in s")


class DiskView(BaseModel):
    """Space of a folder."""

    folder: str
    path: str
    free_bytes: int
    size_bytes: int


class HealthView(BaseModel):
    """Health of the station."""

    works: bool = Field(description="all parts work")
    parts: list[PartView]
    disks: list[DiskView]
    now: datetime
    clock_is_synchronised: bool | None = Field(description="null if this is not known")


def parts_of(daemon: Daemon) -> list[PartView]:
    """Return the state of all parts."""
    return [
        PartView(
            name=name, works=not part.problem and not part.is_stuck, problem=part.problem,
            looked_s=round(part.looked.elapsed_s(), 1),
        )
        for name, part in daemon.parts.items()
    ]  # fmt: skip


def disks_of(daemon: Daemon) -> list[DiskView]:
    """Return the space at the runs and at the station's own records."""
    found = []
    for name, path in (("runs", daemon.settings.runs), ("station", daemon.settings.folder)):
        usage = shutil.disk_usage(_existing(path))
        found.append(DiskView(folder=name, path=str(path), free_bytes=usage.free, size_bytes=usage.total))
    return found


def health(daemon: Daemon) -> HealthView:
    """Return the health of a station. Blocks until the system has answered about its clock."""
    parts = parts_of(daemon)
    return HealthView(
        works=all(each.works for each in parts), parts=parts, disks=disks_of(daemon), now=wall_utc(),
        clock_is_synchronised=_is_synchronised(),
    )  # fmt: skip


def _existing(path: Path) -> Path:
    return next(each for each in (path, *path.parents) if each.exists())


def _is_synchronised() -> bool | None:
    command = ["timedatectl", "show", "--property=NTPSynchronized", "--value"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=CLOCK_ANSWERS_S, check=True).stdout  # noqa: S603  fixed words
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.strip() == "yes"

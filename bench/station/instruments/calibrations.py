"""Calibrations of the instruments of all benches, the next one due first."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, datetime
from enum import StrEnum
from zoneinfo import ZoneInfo

from pydantic import BaseModel, ConfigDict, Field

from bench.config.devices import Calibration
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.station.daemon import Daemon

SOON_DAYS = 30  # at a station without alerts


class DueState(StrEnum):
    """State of a calibration: past due, due within the days of the alerts, or later."""

    PAST = "past"
    SOON = "soon"
    LATER = "later"


class CalibrationView(BaseModel):
    """Certificate of an instrument or of a named reading."""

    model_config = ConfigDict(frozen=True)

    bench: str
    name: str = Field(description="role of the instrument, or name of the reading")
    is_reading: bool = Field(description="of a named reading, such as a thermometer")
    device: str = Field(description="role of the instrument")
    certificate: str
    laboratory: str
    calibrated: date
    due: date
    left_days: int = Field(description="days until it is due; negative if it is past due")
    state: DueState


def days_ahead(daemon: Daemon) -> int:
    """Return how many days ahead of its due date a calibration is shown as due: those of the alerts."""
    alerts = daemon.settings.alerts
    return alerts.entry.calibration_due_within_days if alerts is not None else SOON_DAYS


def calibrations_of(name: str, bench: BenchFile, today: date, soon_days: int) -> list[CalibrationView]:
    """Return the calibrations of a bench, the next one due first."""
    return sorted(_of(name, bench, today, soon_days), key=_by_due)


def all_calibrations(daemon: Daemon, now: datetime) -> list[CalibrationView]:
    """Return the calibrations of all benches, the next one due first; a bench file that cannot be read has none."""
    found: list[CalibrationView] = []
    for name in daemon.settings.benches:
        try:
            bench = daemon.scheduler.bench(name)
        except InputError:
            continue  # its card says so
        found += _of(name, bench, today_at(daemon, name, now), days_ahead(daemon))
    return sorted(found, key=_by_due)


def _by_due(each: CalibrationView) -> tuple[date, str, str]:
    return each.due, each.bench, each.name


def today_at(daemon: Daemon, bench: str, now: datetime) -> date:
    """Return the date at a bench."""
    return now.astimezone(ZoneInfo(daemon.settings.zones.get(bench, "UTC"))).date()


def _of(name: str, bench: BenchFile, today: date, soon_days: int) -> Iterator[CalibrationView]:
    for role, entry in bench.devices.items():
        if entry.calibration is not None:
            yield _view(name, role, role, entry.calibration, today, soon_days)
    for reading, named in bench.readings.items():
        if named.calibration is not None:
            yield _view(name, reading, named.device, named.calibration, today, soon_days)


def _view(bench: str, name: str, device: str, calibration: Calibration, today: date, soon_days: int) -> CalibrationView:
    left_days = (calibration.due - today).days
    state = DueState.PAST if left_days < 0 else DueState.SOON if left_days <= soon_days else DueState.LATER
    return CalibrationView(
        bench=bench, name=name, is_reading=name != device, device=device, certificate=calibration.certificate,
        laboratory=calibration.laboratory, calibrated=calibration.date, due=calibration.due, left_days=left_days,
        state=state,
    )  # fmt: skip

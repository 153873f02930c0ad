"""Settings of alerts: the block `alerts` of `station.yaml`, and the file with the addresses, which are secrets."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self
from urllib.parse import urlsplit
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, Field, SecretStr, StringConstraints, model_validator

from bench.config.document import read_document
from bench.config.models import TimeZone
from bench.errors import InputError
from bench.files import expect_private
from bench.station.alerts.kinds import ENDS, Kind
from bench.station.queue.items import Word
from drivers.schema.fields import NOT_EMPTY, PositiveSeconds, StrictModel, WholeNumber
from drivers.schema.wording import telling

ClockTime = Annotated[str, StringConstraints(pattern=r"^([01][0-9]|2[0-3]):[0-5][0-9]$")]


def _address(text: str) -> str:
    if text and urlsplit(text).scheme not in ("http", "https"):
        raise telling("is no address of a page, expected one like https://bench-3.example/")
    return text if text.endswith("/") or not text else f"{text}/"


class RouteEntry(StrictModel):
    """Route of alerts to a person."""

    events: Annotated[tuple[Kind, ...], NOT_EMPTY] = Field(tuple(Kind), description="kinds of alerts that go this way")
    next: Word | None = Field(None, description="route to take when nobody acknowledges an urgent alert of this one")
    language: Literal["en", "zh"] = Field("en", description="language of its texts")
    same_person_as: tuple[Word, ...] = Field(
        (), description="benches whose own alert program reaches the same person: what it reports is not sent again"
    )


class AlertsEntry(StrictModel):
    """Alerts of a station."""

    addresses: str = Field(
        description="file of mode 0600 with the address of each route, as `NAME: URL`; relative to this file"
    )
    routes: Annotated[Mapping[Word, RouteEntry], NOT_EMPTY] = Field(description="routes by name")
    page: Annotated[str, AfterValidator(_address)] = Field(
        "", description="address of the station's pages in alerts; without it that of its own computer"
    )
    time_zone: TimeZone = Field("UTC", description="of times in alerts, such as Europe/Berlin")
    digest: ClockTime | None = Field("07:00", description="time of the daily digest; null for none")
    escalate_after: PositiveSeconds = Field(900.0, description="time to acknowledge an urgent alert")
    calibration_due_within_days: WholeNumber = Field(30, description="days ahead of a due calibration")
    disk_free_gb: Annotated[float, Field(gt=0)] = Field(5.0, description="free space in GB below which the disk is low")

    @model_validator(mode="after")
    def _routes_lead_on(self) -> Self:
        for name, route in self.routes.items():
            if route.next is not None and route.next not in self.routes:
                raise telling(f"the route after '{name}', '{route.next}', is none of {', '.join(self.routes)}")
        return self


class Route(NamedTuple):
    """Route with its address."""

    name: str
    entry: RouteEntry
    url: SecretStr

    @property
    def key(self) -> str:
        """Identification of the address in a record, which does not show it."""
        return hashlib.sha256(f"{self.name}\n{self.url.get_secret_value()}".encode()).hexdigest()


class AlertSettings(NamedTuple):
    """Settings of alerts with the addresses of all routes."""

    entry: AlertsEntry
    routes: Mapping[str, Route]

    @property
    def zone(self) -> ZoneInfo:
        """Time zone of times in alerts."""
        return ZoneInfo(self.entry.time_zone)

    @property
    def for_the_night(self) -> tuple[str, ...]:
        """Routes that learn of the end of a run, as `NAME=KEY`: one of them must work when nobody is there."""
        return tuple(f"{each.name}={each.key}" for each in self.routes.values() if set(each.entry.events) >= ENDS)


def read_alerts(entry: AlertsEntry, beside: Path, benches: Collection[str]) -> AlertSettings:
    """Return the settings with the addresses from their file. Raises InputError; no message shows an address."""
    named = {bench for route in entry.routes.values() for bench in route.same_person_as}
    if unknown := sorted(named - set(benches)):
        raise InputError(f"same_person_as: the station has no bench '{unknown[0]}'; it has {', '.join(benches)}")
    path = beside / entry.addresses
    expect_private(path, "addresses", is_own=True)
    found = read_document(path).value
    urls = found.values() if isinstance(found, Mapping) else [None]
    if not all(isinstance(url, str) and urlsplit(url).scheme for url in urls):
        raise InputError(f"{path}: expected one line `NAME: URL` for each route, such as `phone: ntfys://…`")
    if missing := [name for name in entry.routes if name not in found]:
        raise InputError(f"{path}: has no address of {', '.join(missing)}")
    if found.keys() - entry.routes.keys():
        raise InputError(f"{path}: has a line that is no route of the settings; they have {', '.join(entry.routes)}")
    return AlertSettings(
        entry, {name: Route(name, route, SecretStr(str(found[name]))) for name, route in entry.routes.items()}
    )

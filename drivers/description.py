"""Descriptions of drivers for the bench file, known without importing the driver.

Each dialect package has a `description.py` with a DESCRIPTION; the entry-point group `inertial_test_bench.drivers`
finds it, a plug-in's too. The class is imported when the device is opened.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from pydantic import BaseModel, Field

from drivers.can.sent_frames import SentFrames
from drivers.capabilities import Device
from drivers.errors import WrongIdentity
from drivers.installed import Installed, loaded
from drivers.person import NO_OPERATOR, Person
from drivers.safe_state import NOT_DESCRIBED, SafeState
from drivers.schema.fields import Spelled, StrictModel
from drivers.shipped import DRIVERS
from drivers.timing.busy import BUSY_S

if TYPE_CHECKING:  # the check of a bench file must not import what only an opened device needs
    from drivers.discovery.recognition import Recognition
    from drivers.transport.address import Address
    from drivers.transport.wires import Wires
    from drivers.values import Identity

ENTRY_POINTS = "inertial_test_bench.drivers"
OptionsT = TypeVar("OptionsT", bound=BaseModel)
LimitsT = TypeVar("LimitsT", bound=BaseModel)
SafeT = TypeVar("SafeT", bound=BaseModel)


class Nothing(StrictModel):
    """Empty block, of a driver that has no options, limits, safe settings or calibration of its own."""


class IdentityPin(StrictModel):
    """The identity stated in the bench file; missing parts are not compared."""

    maker: Spelled | None = Field(None, description="as reported")
    model: Spelled | None = Field(None, description="as reported")
    serial: Spelled | None = Field(None, description="serial number; not compared if the instrument does not report it")
    firmware: Spelled | None = Field(None, description="version, as reported")


class DriverDescription(NamedTuple):
    """Description of a driver.

    `busy_s` is the longest time for which a working device may give no reading, because it moves, averages or is slow;
    or a function of options and limits that returns it. `reports_every_s` is the delay of readings that the driver
    processes together. `safe_state` describes `make_safe`; or a function of options, limits and safe that returns it.
    `channels` are the readings of `poll`, with their units, or a function of the options that returns them. `options`,
    `limits`, `safe`, `uncertainty` and `corrections` are the models of those blocks of a device entry (`calibration.U`
    and `calibration.corrections` for the last two). `target` is "module:Class"; so is `simulator`, which is known by
    name only and may be missing. `recognition` is "module:NAME" of the Recognition used by a scan; without it a scan
    does not find the instrument. `frames` describes the frames of a device that sends unsolicited, and their decoder;
    else None.
    """

    name: str
    title: str
    capabilities: frozenset[str]
    schemes: frozenset[str]
    target: str
    options: type[BaseModel] = Nothing
    limits: type[BaseModel] = Nothing
    safe: type[BaseModel] = Nothing
    safe_state: SafeState | Callable[[Any, Any, Any], SafeState] = NOT_DESCRIBED
    uncertainty: type[BaseModel] = Nothing
    corrections: type[BaseModel] = Nothing
    simulator: str = ""
    recognition: str = ""
    reports_every_s: float = 0.0
    busy_s: float | Callable[[Any, Any], float] = BUSY_S
    channels: Mapping[str, str] | Callable[[Any], Mapping[str, str]] = MappingProxyType({})
    frames: SentFrames | None = None

    def channels_of(self, options: BaseModel) -> Mapping[str, str]:
        """Readings of a device with these options: name → unit."""
        return self.channels(options) if callable(self.channels) else self.channels

    def safe_state_of(self, options: BaseModel, limits: BaseModel, safe: BaseModel) -> SafeState:
        """Safe state of a device with these blocks of its entry, and its time limit."""
        return self.safe_state if isinstance(self.safe_state, SafeState) else self.safe_state(options, limits, safe)

    def busy_s_of(self, options: BaseModel, limits: BaseModel) -> float:
        """Longest time for which a device with these blocks of its entry may give no reading."""
        return self.busy_s(options, limits) if callable(self.busy_s) else self.busy_s

    def recognised_by(self) -> Recognition | None:
        """Recognition of the instrument by a scan, from an import of its module; None if it has none."""
        found: Recognition | None = loaded(self.recognition) if self.recognition else None
        return found


def ignore_note(_text: str) -> None:
    """Ignore the notes of a driver."""


@dataclass(frozen=True)
class Setup(Generic[OptionsT, LimitsT, SafeT]):
    """Everything that a driver is constructed from.

    `note` receives notes of automatic actions such as a repeated query or a reconnection. `person` is the operator who
    can be asked to do something by hand.
    """

    name: str
    address: Address
    wires: Wires
    options: OptionsT
    limits: LimitsT
    safe: SafeT
    identity: IdentityPin
    note: Callable[[str], object] = ignore_note
    person: Person = NO_OPERATOR


@lru_cache(maxsize=1)
def known_drivers() -> Mapping[str, DriverDescription]:
    """Every installed driver by name."""
    return Installed(ENTRY_POINTS, DRIVERS)


def make_driver(description: DriverDescription, setup: Setup[OptionsT, LimitsT, SafeT]) -> Device:
    """The driver object, not yet connected; imports its module."""
    driver = loaded(description.target)(setup)
    if not isinstance(driver, Device):
        raise TypeError(f"{description.target} is not a device")
    return driver


def check_identity(device: str, pin: IdentityPin, found: Identity) -> None:
    """Raise WrongIdentity unless every pinned field that the instrument reports is as pinned."""
    for what in ("maker", "model", "serial", "firmware"):
        expected, answered = getattr(pin, what), getattr(found, what)
        if expected is None or (what == "serial" and not found.verified):
            continue
        if expected != answered:
            raise WrongIdentity(
                device, f"{what} is '{answered}', the bench file says '{expected}'",
                remedy="Check that the right instrument is on this port, or correct the bench file.",
            )  # fmt: skip

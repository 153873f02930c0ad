"""Descriptions of the test methods that a sequence can use, loaded without importing their arithmetic.

The entry-point group `inertial_test_bench.methods` provides the descriptions, including those of plug-ins.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterator, Mapping
from functools import cached_property, lru_cache
from itertools import chain
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel

from bench.config.places import UnitKind
from drivers.installed import Installed, loaded

ENTRY_POINTS = "inertial_test_bench.methods"
SHIPPED: Mapping[str, str] = {
    "imu_calibration": "bench.methods.imu.method:IMU_CALIBRATION",
    "imu_start_up": "bench.methods.imu.method:IMU_START_UP",
    "indexing_static": "bench.methods.indexing.method:INDEXING_STATIC",
    "repeatability": "bench.methods.tumble.method:REPEATABILITY",
    "channel_temperature": "bench.methods.channel.method:CHANNEL_TEMPERATURE",
    "accelerometer_range": "bench.methods.rate_table.method:ACCELEROMETER_RANGE",
    "accelerometer_response": "bench.methods.rate_table.method:ACCELEROMETER_RESPONSE",
    "gyro_range": "bench.methods.rate_table.method:GYRO_RANGE",
    "gyro_response": "bench.methods.rate_table.method:GYRO_RESPONSE",
    "temperature_ramp": "bench.methods.ramp.method:TEMPERATURE_RAMP",
    "temperature_tumble": "bench.methods.tumble.method:TEMPERATURE_TUMBLE",
    "verify_compensation": "bench.methods.tumble.method:VERIFY_COMPENSATION",
    "verify_on_ramp": "bench.methods.ramp.method:VERIFY_ON_RAMP",
    "threshold": "bench.methods.threshold.method:THRESHOLD",
}
OUTPUT = "output"  # as the unit of a quantity: stands for the unit of the units' output
OUTPUT_UNITS = ("pulse/s", "V", "code")
NOTHING: Mapping[str, str] = MappingProxyType({})
GYRO_OUTPUT = "gyro_output"  # likewise, for the gyros of an inertial unit
CIRCUIT_OUTPUT = "circuit_output"  # likewise, for the temperature circuit of an inertial unit


CHANNEL = (
    "The unit is measured together with its I/F converter. K0, in units of local g, contains the converter's zero. K1"
    " contains the converter's scale, and K3 unless the angles separate it; likewise K2 contains the converter's "
    "asymmetry. The misalignment contains the zero error of the head and the level of the fixture, both within its "
    "uncertainty."
)


Units = Mapping[str, str | tuple[str, str]]
"""Unit of each quantity, or a pair of its unit and the one that a report displays."""
CountsAt = Literal["dwells", "ramps", "steps", "levels", "windows", "table", "records"]


class NamedPart(NamedTuple):
    """A loop or a group of a sequence that a reduction finds by name around an acquisition of its data.

    `meaning` describes it in the reference. `without` states what the results lack if no acquisition is in such a part,
    for the check; "" if nothing.
    """

    name: str
    kind: Literal["loop", "group"]
    meaning: str
    without: str = ""


class MethodDescription(NamedTuple):
    """Description of a method for sequences, checks and reports.

    `settings` validates its settings. `quantities` are the results that limits may name, each with its unit or a pair
    of that and the one that a report displays; OUTPUT stands for the unit of the units' output, GYRO_OUTPUT for that of
    their gyros, CIRCUIT_OUTPUT for that of their temperature circuit. `target` is "module:function", which reduces the
    data of a run to findings. `counts_at` is the layout of its acquisitions: readings at dwells, each a leg of a
    temperature ramp, steps of a ladder, each at one input level, each a window of which only the means are used, each
    on a table at rest or in motion, or each a record of its own. `first_dwell` is the number of its first dwell in the
    report. `drawn_by` is "module:function", which returns the plots and tables of a unit that a report shows beside the
    tables common to all methods. `after` names the standards it follows (equations 7), without a claim of conformity.
    `shown` are displayed units of other results, or of quantities that have no pair. `rules`, `words`, `translations`,
    `spans`, `offline` and `truth` are "module:attribute" too, empty for none: its Rules on a plan, its words by kind
    (`MethodWords`, `texts_of`), translations of its texts by language, the function that divides the run into spans,
    its reductions of recorded cases, and the function that computes the truth of simulated data from the RunData of a
    label and the World of the simulation. `parts` are the loops and groups that its reduction finds by name. `meaning`
    describes its results, `measures` its kind of unit or several, `needs_calibration` is true if it needs a released
    calibration of each unit, `closes` if it uses the acquisitions of `closure` like its other data.
    """

    name: str
    title: str
    target: str
    settings: type[BaseModel]
    quantities: Units
    counts_at: CountsAt = "dwells"
    first_dwell: int = 0
    drawn_by: str = ""
    rules: str = ""
    words: str = ""
    spans: str = ""
    offline: str = ""
    after: tuple[str, ...] = ()
    parts: tuple[NamedPart, ...] = ()
    meaning: str = CHANNEL
    measures: UnitKind | tuple[UnitKind, ...] = "channel"
    needs_calibration: bool = False
    closes: bool = False
    shown: Mapping[str, str] = NOTHING
    translations: str = ""
    truth: str = ""

    def units(
        self, output_unit: str, gyro_output_unit: str | None = None, circuit_unit: str | None = None
    ) -> Mapping[str, str]:
        """Units of the quantities for units with output in `output_unit`, and gyros in `gyro_output_unit`.

        `circuit_unit` is that of a temperature circuit, Hz if there is none.
        """
        of_part = {CIRCUIT_OUTPUT: circuit_unit or "Hz", GYRO_OUTPUT: gyro_output_unit or output_unit}
        found = {}
        for name, unit in self.stated.items():
            for part, own in of_part.items():
                unit = unit.replace(part, own)
            found[name] = unit.replace(OUTPUT, output_unit)
        return found

    @property
    def kinds(self) -> tuple[UnitKind, ...]:
        """Kinds of units that it measures."""
        return self.measures if isinstance(self.measures, tuple) else (self.measures,)

    @property
    def stated(self) -> dict[str, str]:
        """Unit of each quantity."""
        return {name: unit if isinstance(unit, str) else unit[0] for name, unit in self.quantities.items()}

    @property
    def displayed(self) -> dict[str, str]:
        """Displayed unit of each result with another one than its own."""
        pairs = {name: unit[1] for name, unit in self.quantities.items() if not isinstance(unit, str)}
        return {**pairs, **self.shown}


class MethodWords(Mapping[str, str]):
    """Words of one kind, such as `REASONS`: common ones, and those of all installed methods, loaded on demand."""

    def __init__(self, kind: str, generic: Mapping[str, str]) -> None:
        self._kind, self._generic = kind, generic

    @cached_property
    def _all(self) -> Mapping[str, str]:
        return ChainMap(dict(self._generic), *(dict(words) for words in _words_of_methods(self._kind)))

    def __getitem__(self, key: str) -> str:
        return self._generic[key] if key in self._generic else self._all[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)


@lru_cache
def texts_of(kind: str, generic: tuple[str, ...]) -> tuple[str, ...]:
    """Texts of one kind without keys, such as `NOTES`: common ones and those of all installed methods."""
    return (*generic, *chain.from_iterable(_words_of_methods(kind)))


def _words_of_methods(kind: str) -> Iterator[Any]:
    """Words of one kind of each installed method."""
    targets = dict.fromkeys(method.words for method in shipped_first() if method.words)
    return (words[kind] for words in map(loaded, targets) if kind in words)


@lru_cache(maxsize=1)
def known_methods() -> Mapping[str, MethodDescription]:
    """Every installed method by name."""
    return Installed(ENTRY_POINTS, SHIPPED)


def shipped_first() -> tuple[MethodDescription, ...]:
    """Every installed method, shipped ones first, so that a plug-in does not replace their words."""
    known = known_methods()
    return tuple(known[name] for name in sorted(known, key=lambda name: name not in SHIPPED))

"""What a sequence may ask of the test methods, known without importing their arithmetic.

The entry-point group `inertial_test_bench.methods` finds descriptions, a plug-in's too.
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
    "threshold": "bench.methods.threshold.method:THRESHOLD",
}
OUTPUT = "output"  # in the unit of a quantity: stands for the unit of the units' output
OUTPUT_UNITS = ("pulse/s", "V", "code")
NOTHING: Mapping[str, str] = MappingProxyType({})
GYRO_OUTPUT = "gyro_output"  # likewise, of the gyros of an inertial unit


CHANNEL = (
    "The unit is measured together with its I/F converter. K0, in units of local g, contains the converter's zero. K1 "
    "contains the converter's scale, and K3 where the angles do not tell it by itself; so K2 contains the converter's "
    "asymmetry. The misalignment contains the zero error of the head and the level of the fixture, both within its "
    "uncertainty."
)


CountsAt = Literal["dwells", "ramps", "steps", "levels", "windows", "table", "records"]


class NamedPart(NamedTuple):
    """A loop or a group of a sequence whose name a reduction looks for around an acquisition of its data.

    `meaning` is that of the name, for the reference. `without` states what the results lack if no acquisition is in
    such a part, for the check; "" if nothing.
    """

    name: str
    kind: Literal["loop", "group"]
    meaning: str
    without: str = ""


class MethodDescription(NamedTuple):
    """A method as a sequence sees it.

    `settings` validates its settings; `quantities` are the results that limits may name, with their units, in which
    OUTPUT stands for that of the units' output, and GYRO_OUTPUT for that of their gyros. `target` is "module:function",
    which turns a run's data into findings.
    `counts_at` says what its acquisitions are: readings at dwells, each a leg of a temperature ramp, steps of a ladder,
    each at one input level, each a window of which only the means are wanted, each on a table at rest or in motion, or
    each a record of its own. `first_dwell` is the number that the report gives to the first of its dwells. `drawn_by`
    is "module:function", which turns a unit's results into what a report shows of them beside the tables that all
    methods have. `after` names the standards that it is made after (equations 7), which is no claim of conformity.
    `shown` are the units in which a report shows quantities that it does not show in the unit in which they are found.
    `rules`, `words`, `translations`, `spans`, `offline` and `truth` are "module:attribute" as well, empty for none: its
    Rules on a plan, its words by their kinds (`MethodWords`, `texts_of`), translations of its texts by language, the
    function that divides the run into spans, its reductions of recorded cases, and the function that gives what is true
    of simulated data, from the RunData of a label and the World of the simulation.
    `parts` are the loops and groups whose names its reduction looks for. `meaning` says what its results contain,
    `measures` what kind of unit it is for, `needs_calibration` whether it needs the calibration that was released for
    each unit, `closes` whether it looks at what was acquired for `closure`, as its other data are.
    """

    name: str
    title: str
    target: str
    settings: type[BaseModel]
    quantities: Mapping[str, str]
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
    measures: UnitKind = "channel"
    needs_calibration: bool = False
    closes: bool = False
    shown: Mapping[str, str] = NOTHING
    translations: str = ""
    truth: str = ""

    def units(self, output_unit: str, gyro_output_unit: str | None = None) -> Mapping[str, str]:
        """The units of the quantities for units whose output is in `output_unit`, that of their gyros maybe another."""
        return {
            name: unit.replace(GYRO_OUTPUT, gyro_output_unit or output_unit).replace(OUTPUT, output_unit)
            for name, unit in self.quantities.items()
        }


class MethodWords(Mapping[str, str]):
    """Words of one kind, such as `REASONS`: generic ones, and those of all installed methods when one is looked up."""

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
    """Texts of one kind without keys, such as `NOTES`: generic ones and those of all installed methods."""
    return (*generic, *chain.from_iterable(_words_of_methods(kind)))


def _words_of_methods(kind: str) -> Iterator[Any]:
    """The words of one kind that each installed method brings."""
    targets = dict.fromkeys(method.words for method in shipped_first() if method.words)
    return (words[kind] for words in map(loaded, targets) if kind in words)


@lru_cache(maxsize=1)
def known_methods() -> Mapping[str, MethodDescription]:
    """Every installed method by name."""
    return Installed(ENTRY_POINTS, SHIPPED)


def shipped_first() -> tuple[MethodDescription, ...]:
    """Every installed method; a word that a shipped one has is not replaced by a plug-in's."""
    known = known_methods()
    return tuple(known[name] for name in sorted(known, key=lambda name: name not in SHIPPED))

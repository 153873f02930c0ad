"""Flags: what a reader must know of a result, as data that reports put into words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

SAMPLES = "{count} samples: {why}"
INVALID, ILL_CONDITIONED, TOO_FEW_TEMPERATURES = "invalid", "ill_conditioned", "too_few_temperatures"
ONE_NOT_DETERMINED = (
    "{names} is not determined by these readings (rank {rank} of {count}, condition number {condition})"
)
NOT_DETERMINED = "{names} are not determined by these readings (rank {rank} of {count}, condition number {condition})"


@dataclass(frozen=True, slots=True)
class Flag:
    """A remark on the results of a unit; `str` gives its form in `results.json` and in results of cases.

    `code` is a name, or a sentence for the reader; names in braces in it stand for `values`. `at` is the step, path or
    part of the run that the remark is on, `of` the quantity, level or instrument.
    """

    code: str
    at: str = ""
    of: str = ""
    values: Mapping[str, object] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        """Its form in results, such as "steps/acquire#3: dead_band" or "K0:too_few_temperatures"."""
        code = self.code.format(**self.values) if self.values else self.code
        return "".join((f"{self.at}: " if self.at else "", f"{self.of}:" if self.of else "", code))


def samples_left_out(why: str, count: int, at: str = "") -> Flag:
    """The flag for samples that are not used."""
    return Flag(SAMPLES, at, values={"count": count, "why": why})

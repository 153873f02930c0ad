"""Settings of a current source, and the safe sequence from one to another; no I/O."""

from __future__ import annotations

from typing import NamedTuple

from drivers.protocols import scpi


class Setting(NamedTuple):
    """Wanted setting of an output: range, level, compliance, on or off."""

    range_a: float
    level_a: float
    compliance_v: float
    output: bool

    @property
    def flowing_a(self) -> float:
        """Level while the output is on, else 0."""
        return self.level_a if self.output else 0.0

    def switched_off(self) -> Setting:
        """The same with the output off."""
        return self._replace(output=False)

    def __str__(self) -> str:
        return (
            f"{self.level_a:g} A in the {self.range_a:g} A range, compliance {self.compliance_v:g} V, "
            f"output {'on' if self.output else 'off'}"
        )


class Commands(NamedTuple):
    """Commands of a dialect; a number follows the headers `range`, `compliance` and `level`."""

    range: str
    compliance: str
    level: str
    on: str
    off: str

    @property
    def zero(self) -> str:
        """Command: go to 0 A."""
        return f"{self.level} 0"

    @property
    def cut_off(self) -> str:
        """Command: go to 0 A and switch the output off."""
        return f"{self.zero};{self.off}"

    def step_off(self, has: Setting) -> str:
        """Next command on the way to 0 A with the output off, "" when it is reached."""
        if has.level_a != 0:
            return self.zero
        return self.off if has.output else ""

    def next_step(self, has: Setting, wanted: Setting, *, level_step_a: float, compliance_step_v: float) -> str:
        """Next command on the way to a setting, "" when it is reached.

        The range changes at 0 A with the output off, the polarity through 0 A; compliance and level come before the
        output goes on, and it goes off at 0 A. The steps are the resolutions of the instrument.
        """
        if not wanted.output:
            return self.step_off(has)
        if abs(has.range_a - wanted.range_a) > 0.01 * wanted.range_a:
            return self.step_off(has) or f"{self.range} {scpi.spell(wanted.range_a)}"
        if not _took(has.compliance_v, wanted.compliance_v, compliance_step_v):
            return f"{self.compliance} {scpi.spell(wanted.compliance_v)}"
        if not _took(has.level_a, wanted.level_a, level_step_a):
            return self.zero if has.level_a * wanted.level_a < 0 else f"{self.level} {scpi.spell(wanted.level_a)}"
        return "" if has.output else self.on


def _took(has: float, wanted: float, step: float) -> bool:
    """Return whether an instrument has the value that was sent, rounded to its step."""
    return abs(has - float(scpi.spell(wanted))) <= 0.51 * step

"""The lines of the scorecard: what is claimed, how many trials prove it, and what plays one."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import NamedTuple


class Line(NamedTuple):
    """A claim. `bar` is how many trials it needs, `plays` is "module:function" of one, which has `of` cases in it.

    The function takes the number of the trial, from which everything is drawn, and returns what is wrong, or "".
    """

    key: str
    claim: str
    bar: int
    plays: str
    of: int = 1

    def trial(self, number: int) -> str:
        """Play one; what is wrong, "" if nothing."""
        module, _, function = self.plays.partition(":")
        wrong: str = getattr(import_module(f"campaigns.reliability.{module}"), function)(number)
        return wrong


LINES: Mapping[str, Line] = {
    line.key: line
    for line in (
        Line("S1", "line faults: no wrong value, no order sent twice", 420, "wires:line_faults", of=50),
        Line("S2", "faults on CAN buses: gaps exact, no wrong count without a word", 200, "wires:can_faults", of=50),
        Line("S3", "what is no temperature is refused, whatever its 32 bits", 100, "wires:not_a_number", of=100),
        Line("S4", "swapped instruments and second masters: nothing told to another", 100, "wires:swaps", of=20),
        Line("S5", "thermal faults: none goes unnoticed, and nothing is reported without one", 200, "nights:thermal"),
        Line("S6", "aborted at any moment, one device broken: the others are safe in time", 500, "stops:aborted"),
        Line("S7a", "run killed, frozen or without memory, over wires: safe, asked by another client", 200,
             "guarded:run_lost"),
        Line("S7b", "the same with one instrument that does not answer", 50, "guarded:one_device_dead"),
        Line("S7c", "the guardian killed: the run ends, and the bench is safe", 50, "guarded:guardian_lost"),
        Line("S7d", "the run killed on a machine at load 20", 50, "guarded:under_load"),
        Line("S8", "the computer stands still: a supply with a watchdog is off by itself", 50,
             "guarded:computer_lost"),
        Line("S9a", "kill -9: acknowledged rows and inputs are there", 200, "records:killed"),
        Line("S9b", "kill -9 at each system call that writes: the record is whole", 800, "records:killed_at_a_call"),
        Line("S10", "power cut of a real ext4: acknowledged rows and inputs are there", 200, "records:power_cut"),
        Line("S11", "records with flipped, cut and edited bytes: none is called as written", 400, "records:altered"),
        Line("S12", "the n-th storage operation fails, once or for good: safe, and the reason told", 400,
             "records:storage_fails"),
        Line("S13", "runs killed at any moment are resumed: complete, nothing done twice", 200, "resumes:once"),
        Line("S13w", "the same over wires in real time, of a run of five minutes", 20, "resumes:over_wires"),
        Line("S14", "runs killed again when resumed: complete", 20, "resumes:twice"),
        Line("S15", "clock set, slewed, asleep, in every step and over interruptions: order and durations as without",
             200, "clocks:clock"),
        Line("S16", "faults in a night of 16 h: none unsafe, none lost, every end has its cause", 1000,
             "nights:night"),
    )
}  # fmt: skip

"""Credit of one soak in a resumed run: the first reading of the chamber, and the decision when the soak begins."""

from __future__ import annotations

import asyncio
from typing import Any, NamedTuple

from bench.clock import boot_id, since_boot_s, wall_utc
from bench.engine.credit import GAP_S, Chamber, ChamberReading, GuardedPeriod, Instant, NoCredit, Soaked, credit_s
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.quality import Invalid, Window
from bench.rig import Rig
from bench.sequence.plan.dwells import first_visit
from bench.sequence.steps.custom import Custom
from bench.sequence.steps.stimulus import Ramp, SetOutput
from bench.sequence.steps.verbs import Step
from bench.sequence.steps.waits import Soak
from drivers.errors import DriverError
from drivers.timing.awake import fair_timeout

LOOKED_AT_WITHIN_S = 5.0


class SoakEvidence(NamedTuple):
    """Evidence on a soak before its run was resumed: from its record and from its guardian."""

    chamber: Chamber
    soaked: Soaked
    held: GuardedPeriod


class SoakCredit:
    """Decide how much of the soak `step` counts as passed; once, when it begins for the first time.

    `claim` is the evidence, or the reason why there is no credit. What happens to the chamber and its unit between the
    first reading and the soak may still withdraw the credit.
    """

    def __init__(self, step: str, claim: SoakEvidence | str) -> None:
        self._step = step
        self._proved = None if isinstance(claim, str) else claim
        self._why = ""
        if isinstance(claim, str):
            self.rule_out(claim)
        self._credit_s = self._looked_s = 0.0
        self._is_open = True

    def rule_out(self, why: str) -> None:
        """Withdraw the credit; the first reason is kept."""
        self._why = self._why or why.rstrip(".")

    async def look(self, rig: Rig) -> None:
        """Read the chamber before this run commands anything: the credited time ends here."""
        if self._proved is None or self._why:
            return
        chamber, soaked, held = self._proved
        try:
            async with fair_timeout(LOOKED_AT_WITHIN_S):
                state = await rig.chamber(chamber.role).state()
            now = Instant(boot_id(), since_boot_s(), wall_utc().timestamp())
            from_safe_c = float("nan") if state.from_safe_c is None else state.from_safe_c
            look = ChamberReading(now, state.process_value_c, state.target_c, from_safe_c)
            self._credit_s = credit_s(soaked, held, look, chamber)
        except (NoCredit, DriverError) as problem:
            self.rule_out(str(problem))
        except TimeoutError:
            self.rule_out(f"{chamber.role} did not answer")
        self._looked_s = asyncio.get_running_loop().time()

    def begins(self, step: Step) -> None:
        """Withdraw the credit if a step that begins before the soak disturbs the unit or the chamber."""
        match step:
            case SetOutput() if step.output == "on":
                self.rule_out(f"{step.role} is on before it")
            case Ramp() if self._proved is not None and step.temperature_c != self._proved.soaked.set_point_c:
                self.rule_out("the set point changes before it")
            case Custom():
                self.rule_out(f"what the step of a plug-in {step.name} energises is not known")
            case _:
                pass

    def given_s(self, step: Soak, step_id: str, monitor: Monitor, journal: Journal) -> tuple[float, str]:
        """Write to the journal and return the seconds of `at_least` that count as passed, and a message."""
        if not self._is_open or first_visit(step_id) != self._step or not step.at_least_s:
            return 0.0, ""
        self._is_open = False
        self._judge_since_look(monitor)
        if self._proved is None or self._why:
            journal.write("soak_credit", step_id, credit_s=0.0, at_least_s=step.at_least_s, why=self._why)
            return 0.0, f"No credit for the soak {step_id}: {self._why}. It is done in full."
        chamber, soaked, held = self._proved
        given_s = round(min(self._credit_s, step.at_least_s), 3)
        facts: dict[str, Any] = {"chamber": chamber.role, "set_point_c": soaked.set_point_c, "band_c": chamber.band_c}
        facts |= {"since_s": soaked.since_s, "looks": held.looks, "longest_gap_s": round(held.longest_s, 3)}
        journal.write("soak_credit", step_id, credit_s=given_s, at_least_s=step.at_least_s, **facts)
        return given_s, (
            f"The soak {step_id} is credited with {given_s / 60:.3g} of {step.at_least_s / 60:g} min: {chamber.role} "
            f"was held at {soaked.set_point_c:g} °C, its air within {chamber.band_c:g} °C, without a gap."
        )

    def _judge_since_look(self, monitor: Monitor) -> None:
        """Check the readings since the first one of this process; one that has not arrived counts as old as that."""
        if self._proved is None or self._why:
            return
        chamber, soaked, _ = self._proved
        since_s = asyncio.get_running_loop().time() - self._looked_s
        found = monitor.window(chamber.air, since_s, self._looked_s)
        if isinstance(found, Window):
            if not (abs(found.values - soaked.set_point_c) <= chamber.band_c).all():
                self.rule_out(f"the air left {soaked.set_point_c:g} ± {chamber.band_c:g} °C before it")
        elif isinstance(found, Invalid) or since_s > GAP_S:
            self.rule_out(f"{chamber.air} {found.why}")

"""A unit of the other sign: a run's own readings with every output negated, reduced beside the run.

    python -m campaigns.truth.signs RUN ...

tells of stored runs which findings differ in more than their sign. Counts are exchanged, volts, codes and the currents
of a source are negated, and so are the scale factors that bench file and sequence state: nothing else is another unit.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.metrology.acquisition import Acquisition
from bench.metrology.calibration.response import ResponseCompensation
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.reduce.stored_run import StoredRun, open_run
from bench.report.afterwards import Afterwards
from bench.report.html import render
from bench.report.revision import Revision
from bench.sequence.document.model import ResultEntry

TUMBLED = ("K1", "K1_si", "asymmetry")
ODD = {  # by method: outputs, and outputs for an input, which change their sign with the unit's
    "temperature_tumble": TUMBLED,
    "repeatability": TUMBLED,
    "channel_temperature": ("rate", "rate/temperature_coefficient", "zero", "zero/drift", "tempco_offset"),
    "indexing_static": ("K1", "K1_si", "bias", "bias_corrected", "bias_total", "b4", "b5"),
    "imu_calibration": ("K1", "K1_si", "KG"),
}
ROUNDING = 1e-6  # of a value, and of its uncertainty
PROBES = np.linspace(-1.0, 1.0, 5)
SIZES = {"pulse/s": 1000.0, "V": 1.0, "code": 10000.0}  # of outputs


def negated(data: RunData) -> RunData:
    """The data of a run in which every unit's output has the other sign."""
    return replace(
        data,
        units=tuple(_unit(unit) for unit in data.units),
        acquisitions=tuple(_acquisition(each) for each in data.acquisitions),
        closure=tuple(_acquisition(each) for each in data.closure),
    )


def _unit(unit: UnitUnderTest) -> UnitUnderTest:
    per_g = None if unit.nominal_per_g is None else -unit.nominal_per_g
    return replace(unit, nominal_per_g=per_g, scale_a_per_g=-unit.scale_a_per_g)


def _acquisition(each: Acquisition) -> Acquisition:
    return replace(
        each,
        counts={k: replace(c, positive=c.negative, negative=c.positive) for k, c in each.counts.items()},
        windows={k: w._replace(mean=-w.mean) for k, w in each.windows.items()},
        voltages={k: v._replace(values_v=-v.values_v) for k, v in each.voltages.items()},
        codes={k: replace(c, values=-c.values) for k, c in each.codes.items()},
        currents={k: c._replace(values_a=-c.values_a) for k, c in each.currents.items()},
        sources_a={k: -a for k, a in each.sources_a.items()},
        sources_set_a={k: -a for k, a in each.sources_set_a.items()},
    )


def of_other_sign(run: StoredRun) -> StoredRun:
    """The run as it would be stored of units of the other sign."""
    other = StoredRun(run.folder, run.manifest, run.reader)
    other.sequence = run.sequence.model_copy(update={"results": [_stated(entry) for entry in run.sequence.results]})
    labels = {label for entry in run.sequence.results for label in entry.labels}
    other._data = {label: negated(run.data(label)) for label in labels}
    return other


def _stated(entry: ResultEntry) -> ResultEntry:
    """The settings of a method with the scale factors that they state negated."""
    if "scale" not in entry.settings:
        return entry
    given = entry.settings["scale"]
    scales = given if isinstance(given, list | tuple) else [given]
    return entry.model_copy(update={"settings": {**entry.settings, "scale": [f"-{each}" for each in scales]}})


def differences(folder: Path) -> Iterator[str]:
    """Differences in the results and the report of a run with negated outputs, other than signs."""
    with open_run(folder) as run:
        other = of_other_sign(run)
        usual, found = run.evaluate(), other.evaluate()
        methods = [entry.method for entry in run.sequence.results for _ in run.serials]
        for method, one, negated_one in zip(methods, usual.units, found.units, strict=True):
            yield from _of_unit(method, one, negated_one)
        if usual.verdict != found.verdict:
            yield f"verdict {usual.verdict}, negated {found.verdict}"
        render(other, found, "", Revision(1, run.began), Afterwards())


def _of_unit(method: str, usual: UnitResult, other: UnitResult) -> Iterator[str]:
    flags, negated_flags = (list(map(str, each.flags)) for each in (usual, other))
    if flags != negated_flags or usual.left_out != other.left_out:
        yield f"{usual.place}: {flags} {usual.left_out}, negated {negated_flags} {other.left_out}"
    for finding, negated_one in zip(usual.findings, other.findings, strict=True):
        yield from _difference(method, finding, negated_one)
    yield from (f"{model.id}: a negative uncertainty" for model in other.models if _negative_u(model.to_json()))
    for one, negated_one in zip(usual.compensations, other.compensations, strict=True):
        if not _compensate_alike(one, negated_one):
            yield f"{one.channel}: outputs are compensated to other values"


def _difference(method: str, usual: Finding, other: Finding) -> Iterator[str]:
    sign = -1 if usual.quantity in ODD.get(method, ()) else 1
    least = ROUNDING * usual.u
    if usual.id != other.id:
        yield f"{usual.id}, negated {other.id}"
    if not _alike(sign * usual.value, other.value, least):
        yield f"{usual.id}: {usual.value:.9g}, negated {other.value:.9g}"
    if not math.isclose(usual.u, other.u, rel_tol=ROUNDING):
        yield f"{usual.id}: u {usual.u:.6g}, negated {other.u:.6g}"
    sources = [sorted(line.source for line in each.budget) for each in (usual, other)]
    if sources[0] != sources[1] or any(line.u < 0 for line in other.budget):
        yield f"{usual.id}: another budget"
    intervals = [each.interval for each in (usual, other)]
    if None not in intervals:
        ends = [dataclasses.astuple(each) for each in intervals if each is not None]
        if not np.allclose(*ends, rtol=ROUNDING, atol=least):
            yield f"{usual.id}: {intervals[0]}, negated {intervals[1]}"
    elif intervals[0] is not intervals[1]:
        yield f"{usual.id}: only one of both has an interval"


def _alike(one: float, other: float, least: float) -> bool:
    return math.isclose(one, other, rel_tol=ROUNDING, abs_tol=least) or (math.isnan(one) and math.isnan(other))


def _negative_u(model: Any) -> bool:
    """Return whether any `u` in the JSON of a model is below 0."""
    if isinstance(model, Mapping):
        return any(np.min(each, initial=0.0) < 0 if key == "u" and each else _negative_u(each)
                   for key, each in model.items())  # fmt: skip
    return False


def _compensate_alike(one: Any, other: Any) -> bool:
    """Return whether a calibration makes the same of outputs as that of the other sign makes of their opposites."""
    if isinstance(one, ResponseCompensation):
        hz = np.linspace(*one.valid_hz, len(PROBES))
        (size, phase_deg, _), (size_n, phase_n_deg, _) = one.apply(PROBES, PROBES, hz), other.apply(PROBES, PROBES, hz)
        turned_deg = (phase_n_deg - phase_deg) % 360 - 180  # the opposite of a sine is one turned by half a turn
        return np.allclose(size, size_n, rtol=ROUNDING) and np.allclose(turned_deg, 0, atol=1e-3)
    at_c = np.full(len(PROBES), 20.0)
    outputs, sign = PROBES * SIZES[one.output_unit], -1 if one.value_unit == one.output_unit else 1
    return np.allclose(one.apply(outputs, at_c)[0], sign * other.apply(-outputs, at_c)[0], rtol=ROUNDING, atol=1e-9)


def main() -> int:
    found = [f"{path}: {each}" for path in sys.argv[1:] for each in differences(Path(path))]
    print("\n".join(found) or "signs: ok")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())

"""From a stored run to what a method reduces: the journal says what was done, the frames what was counted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from bench.analysis.rundata import Acquisition, BenchRecord, Counts, RunData, UnitUnderTest
from bench.config.models import BenchFile
from bench.sequence.dwells import DwellNames, first_visit
from bench.store.counts import CountDecoder
from bench.store.reader import Event, RunReader, Series
from drivers.can_counter.description import CounterOptions
from drivers.frame_block import FrameBlock

ARCSEC_DEG = 1 / 3600


def run_data(reader: RunReader, bench: BenchFile, serials: Mapping[str, str], label: str) -> RunData:
    """The acquisitions under a label, of the units in their places; StoreError when the run does not hold them."""
    units = tuple(
        UnitUnderTest(
            place, serial, bench.places[place].channel, bench.places[place].mount_angle, bench.places[place].temperature
        )
        for place, serial in serials.items()
    )
    decoders = {
        role: CountDecoder(entry.options, reader.folder)
        for role, entry in bench.devices.items()
        if isinstance(entry.options, CounterOptions)
    }
    temperatures = {unit.temperature: reader.series(unit.temperature) for unit in units}
    frames = reader.frames_by_step()
    acquisitions = tuple(
        _acquisition(event, dwell, state, frames.get(event.step, {}), decoders, temperatures)
        for event, dwell, state in _acquired(reader, bench, label)
    )
    return RunData(label, units, acquisitions, bench_record(bench))


def _acquired(reader: RunReader, bench: BenchFile, label: str) -> Iterator[tuple[Event, str, Mapping[str, float]]]:
    """Finished acquisitions under a label, each with its dwell and with the angle, mount and set point in force.

    Of a step that was done again only the last time counts.
    """
    state = {"angle_deg": 0.0, "mounted_deg": bench.fixture.mounted_deg(), "set_point_c": float("nan")}
    dwells = DwellNames()
    found: dict[str, tuple[Event, str, Mapping[str, float]]] = {}
    begun_c: dict[str, float] = {}
    for event in reader.events("step_begins", "step_ended"):
        if event.kind == "step_begins":
            begun_c[event.step] = state["set_point_c"]
            continue
        state.update({key: float(event.data[key]) for key in state if key in event.data})
        if "mount" in event.data:
            state["mounted_deg"] = bench.fixture.mounted_deg(event.data["mount"])
        if "set_point_c" in event.data:
            dwells.ramped(first_visit(event.step))
        if event.data.get("label") == label:
            step = first_visit(event.step)
            found.pop(step, None)
            found[step] = (event, dwells.of(step), state | {"set_from_c": begun_c[event.step]})
    yield from found.values()


def _acquisition(
    event: Event,
    dwell: str,
    state: Mapping[str, float],
    frames: Mapping[str, FrameBlock],
    decoders: Mapping[str, CountDecoder],
    temperatures: Mapping[str, Series],
) -> Acquisition:
    counts: dict[str, Counts] = {}
    for role, decoder in decoders.items():
        counts.update(decoder.counts(frames.get(role, FrameBlock.empty())))
    parts = event.step.split("/")
    begin_s, end_s = float(event.data["begin_s"]), float(event.data["end_s"])
    meanwhile = {name: series.between(begin_s, end_s) for name, series in temperatures.items()}
    return Acquisition(
        step=event.step,
        group=dwell,
        loops=_loops(parts),
        begin_s=begin_s,
        end_s=end_s,
        angle_deg=state["angle_deg"],
        set_from_c=state["set_from_c"],
        set_c=state["set_point_c"],
        mounted_deg=state["mounted_deg"],
        counts=counts,
        temperatures_c={name: series.values for name, series in meanwhile.items()},
        temperatures_at_s={name: series.at_s for name, series in meanwhile.items()},
    )


def _loops(parts: list[str]) -> dict[str, float]:
    """The numbers that loop variables had, from a step's id."""
    found = {}
    for part in parts:
        name, equals, value = part.partition("=")
        if equals:
            try:
                found[name] = float(value.partition("#")[0])
            except ValueError:
                continue
    return found


def bench_record(bench: BenchFile) -> BenchRecord:
    """What the certificates and surveys of a bench file say, as standard uncertainties u = U / k."""
    head = _uncertainties(bench, "positioner")
    counter = _uncertainties(bench, "pulse_counter")
    gravity, level = bench.site.gravity, bench.fixture.level
    thermometers = {
        name: (reading.calibration.U.offset / reading.calibration.k, reading.calibration.U.gain / reading.calibration.k)
        for name, reading in bench.readings.items()
        if reading.calibration is not None
    }
    return BenchRecord(
        gravity_mps2=gravity.value,
        gravity_u_mps2=gravity.U / gravity.k,
        sense=bench.fixture.input_axis.sense,
        offset_deg=bench.fixture.input_axis.offset_deg,
        level_deg=level.value * ARCSEC_DEG,
        level_u_deg=level.U / level.k * ARCSEC_DEG,
        zero_u_deg=float(head.get("zero", 0.0)) * ARCSEC_DEG,
        harmonics_u_deg=tuple(np.array(head.get("harmonics", ())) * ARCSEC_DEG),
        repeatability_u_deg=float(head.get("repeatability", 0.0)) * ARCSEC_DEG,
        time_base_u=float(counter.get("time_base", 0.0)),
        thermometers_u=thermometers,
    )


def _uncertainties(bench: BenchFile, capability: str) -> dict[str, Any]:
    """The calibrated uncertainties of the first device with a capability, each divided by its k."""
    for entry in bench.devices.values():
        if capability in entry.description.capabilities and entry.calibration is not None:
            stated = entry.calibration.U.model_dump()
            return {name: np.array(U) / entry.calibration.k for name, U in stated.items() if U is not None}
    return {}

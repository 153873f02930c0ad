"""Truth of a channel: the constants that a perfect bench would find, in a file that no reduction reads.

They are defined as the results are: the model equation of the tumble put through the noiseless channel at the positions
that the sequence visits. So K1 contains K3, K2 the converter's asymmetry, and K0 the converter's zero
(equations 8.8). A dwell is evaluated at its *indicated* temperature with the hysteresis, drift and warm-up of that
time. For a leg of a temperature ramp the complete curve is stored: the noiseless output as a function of the
temperature of an ideal thermometer at the unit with the lag of the real one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.physics.attitude import Mount, to_unit
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.units.accelerometer import Decoding, Through, UnitTruth
from simulators.units.accelerometer_unit import SimulatedUnit
from simulators.units.settings import ImuPlace, PlaceSettings
from simulators.world import World

Array = NDArray[np.float64]
LEG_EVERY_S = 10.0
STEPPED = {"turned_on_g": -3, "turned_on_scale": -2}  # columns of a unit's history, by name in the truth
LAST_LATCH_S = 0.1  # possibly before the end of a leg; a sample beyond the end is incomplete
# Separable share of a further term above which the angles of a run determine it. For eight angles and more the shares
# are 1, 0.32 and 0.08 to 0.15; for six, one degree off the level, K3 has 0.02 (equations 1.5).
OWN_SHARE = {"Kip": 0.3, "K3": 0.2, "asymmetry": 0.06}


@dataclass(frozen=True, slots=True)
class Orientation:
    """Nominal angles of the table's axes, outer first, and mounting angles."""

    angles_deg: tuple[float, ...]
    mount: Mount = field(default_factory=Mount)


@dataclass(frozen=True, slots=True)
class DwellAsMeasured:
    """A dwell as in the results: host time of its middle, indicated temperature, attitude at each reading.

    `each_s` are the host times of the middles of the readings; without them the history of the input is ignored.
    """

    key: str
    place: str
    at_s: float
    temperature_c: float
    orientation: tuple[Orientation, ...]
    each_s: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class LegAsMeasured:
    """A leg of a temperature ramp: host time of its ends, and attitude of the unit."""

    key: str
    place: str
    begin_s: float
    end_s: float
    orientation: Orientation


def truth_record(
    world: World,
    dwells: Sequence[DwellAsMeasured],
    legs: Sequence[LegAsMeasured] = (),
    voltmeters: Mapping[str, VoltmeterSettings] | None = None,
    readings: Sequence[LegAsMeasured] = (),
) -> dict[str, Any]:
    """Complete truth of a run: errors of the laboratory, units as drawn, and constants of each dwell and leg.

    For single `readings` it holds the noiseless output on an ideal bench, and the specific force.
    """
    settings = world.settings
    return {
        "schema": "itb-truth/1",
        "seed": settings.seed,
        "bench": {
            "gravity_mps2": settings.gravity_mps2,
            "host_clock": settings.host_clock,
            "device_clock": settings.device_clock,
            "axes": {role: asdict(errors) for role, errors in settings.axes.items()},
            "level_deg": settings.level_deg,
            "level_drift_deg": settings.level_drift_deg,
            "thermometers": {name: asdict(place.thermometer) for name, place in sorted(settings.places.items())},
            **_table(world),
            **({"voltmeters": {role: asdict(meter) for role, meter in voltmeters.items()}} if voltmeters else {}),
            **_decodings(world),
        },
        "units": {name: asdict(unit.truth) for name, unit in world.counted.items()},
        **_seats(world),
        "dwells": _dwells(world, [dwell for dwell in dwells if dwell.place in world.units]),
        "legs": {leg.key: _leg(world, leg) for leg in legs if leg.place in world.units},
        **({"outputs": {each.key: noiseless_output(world, each) for each in readings}} if readings else {}),
        **({"forces_g": {each.key: _force_g(world, each) for each in readings}} if readings else {}),
    }


def _decodings(world: World) -> dict[str, Any]:
    """Decodings of each unit that sends codes; empty if none does."""
    through = {name: unit.settings.through for name, unit in sorted(world.counted.items())}
    found = {name: asdict(each) for name, each in through.items() if isinstance(each, Decoding)}
    return {"telemetry": found} if found else {}


def _seats(world: World) -> dict[str, Any]:
    """Mounting angle of each unit since it was mounted by hand: true time and angle; empty if none was."""
    seats = {name: unit.seats_deg for name, unit in sorted(world.units.items()) if unit.seats_deg}
    return {"seats_deg": seats} if seats else {}


def _table(world: World) -> dict[str, Any]:
    """Errors of a rate table, and the arms of the units on it; empty without one.

    `warm_c` is the temperature of a warmed-up unit in the room.
    """
    settings = world.settings
    if settings.table.loop is None:
        return {}
    places: Mapping[str, PlaceSettings | ImuPlace] = {**settings.places, **settings.imus}
    arms_m = {name: place.arm_m for name, place in sorted(places.items())}
    warm_c = {
        name: settings.chamber.start_c + place.unit.thermal.self_heating for name, place in sorted(places.items())
    }
    return {
        "table": asdict(settings.table), "encoder_skew_s": settings.encoder_skew_s, "arms_m": arms_m,
        "warm_c": warm_c, "room_c": settings.chamber.start_c, "latitude_deg": settings.latitude_deg,
    }  # fmt: skip


def _dwells(world: World, dwells: Sequence[DwellAsMeasured]) -> dict[str, Any]:
    """Truth of each dwell by key; the angles of all dwells of a run together decide on the further terms."""
    angles_deg: dict[str, list[float]] = {}
    for dwell in dwells:
        angles_deg.setdefault(_run_of(dwell), []).extend(
            _axis_deg(world, dwell.place, orientation) for orientation in dwell.orientation
        )
    extra = {run: separable_terms(at_deg) for run, at_deg in angles_deg.items()}
    return {dwell.key: _dwell(world, dwell, extra[_run_of(dwell)]) for dwell in dwells}


def _run_of(dwell: DwellAsMeasured) -> str:
    return dwell.key.partition("@")[0]


def separable_terms(axis_deg: Sequence[float]) -> tuple[str, ...]:
    """Further terms of the model equation that are separable at these angles of the input axis.

    Each column is orthogonalised against the previous ones; the remaining length is its separable part.
    """
    angle = np.radians(np.array(axis_deg))
    sine, cosine = np.sin(angle), np.cos(angle)
    known, found = [np.ones_like(sine), sine, cosine, sine**2], []
    for name, column in (("Kip", sine * cosine), ("K3", sine**3), ("asymmetry", np.abs(sine))):
        others = np.linalg.qr(np.stack(known, axis=-1))[0]
        own = column - others @ (others.T @ column)
        if np.linalg.norm(own) > OWN_SHARE[name] * np.linalg.norm(column):
            known.append(column)
            found.append(name)
    return tuple(found)


def _dwell(world: World, dwell: DwellAsMeasured, extra: Sequence[str]) -> dict[str, Any]:
    """State and constants of a unit in the middle of a dwell, with the further terms `extra`."""
    unit, settings = world.units[dwell.place], world.settings
    true_s = world.true_time(dwell.at_s)
    history = np.array(unit.history)
    drifted_g = float(np.interp(true_s, history[:, 0], history[:, 1] - history[:, -1]))
    each_s = [world.true_time(at_s) for at_s in dwell.each_s]
    by_input_g = np.interp(each_s, history[:, 0], history[:, -1]).tolist() if any(history[:, -1]) else []
    stepped = {name: float(np.interp(true_s, history[:, 0], history[:, column])) for name, column in STEPPED.items()}
    axis_deg = tuple(_axis_deg(world, dwell.place, orientation) for orientation in dwell.orientation)
    constants = channel_constants(
        unit.truth, settings.gravity_mps2, axis_deg, dwell.temperature_c, drifted_g, unit.settings.through, extra,
        by_input_g,
    )  # fmt: skip
    found = {"temperature_c": dwell.temperature_c, "drifted_g": drifted_g, "axis_deg": axis_deg, **constants}
    found |= {name: value for name, value in stepped.items() if value}
    found |= {name: constants[name] * (1 + stepped["turned_on_scale"]) for name in ("K1", "K1_si")}
    found |= {"by_input_g": by_input_g} if by_input_g else {}
    return found | ({"extra": list(extra)} if extra else {})


def gravity_in_unit(world: World, unit: SimulatedUnit, orientation: Orientation) -> Array:
    """Specific force along input, output and pendulous axes in local g, (3,), on the nominal bench."""
    angles_deg = [np.array([angle_deg]) for angle_deg in orientation.angles_deg]
    upward = world.settings.fixture.to_fixture(angles_deg)[0, :, 2]
    return np.asarray(to_unit(orientation.mount, unit.settings.mount_angle_deg) @ upward)


def _axis_deg(world: World, place: str, orientation: Orientation) -> float:
    """Ideal angle of a unit's input axis above the horizontal, up to ±180°."""
    along, _, pendulous = gravity_in_unit(world, world.units[place], orientation)
    return float(np.degrees(np.arctan2(along, pendulous)))


def _force_g(world: World, reading: LegAsMeasured) -> list[float]:
    """Specific force along the input, output and pendulous axes, in the attitude stated by the bench."""
    forces: list[float] = gravity_in_unit(world, world.units[reading.place], reading.orientation).tolist()
    return forces


def noiseless_output(world: World, reading: LegAsMeasured) -> float:
    """Output of the noiseless channel in the middle of a reading, in the attitude stated by the bench."""
    unit = world.units[reading.place]
    true_s = world.true_time((reading.begin_s + reading.end_s) / 2)
    history = np.array(unit.history)
    drifted_g, moving_g, sensor_c = (np.interp([true_s], history[:, 0], row) for row in history.T[1:4])
    along, across, pendulous = gravity_in_unit(world, unit, reading.orientation)
    current_a = unit.truth.current_a((along, pendulous, across), sensor_c, drifted_g + moving_g)
    return float(unit.truth.output(current_a, unit.settings.through)[0])


def _leg(world: World, leg: LegAsMeasured) -> dict[str, Any]:
    """Noiseless output during a leg: temperature, output less gravity in g, K1 in its unit per g.

    Evaluated in the middle of samples of 10 s from its start, by the host's clock; the end matters, because a leg is
    curved at its ends.
    """
    unit = world.units[leg.place]
    cut_s = np.arange(leg.begin_s + LEG_EVERY_S / 2, leg.end_s - LEG_EVERY_S / 2 - LAST_LATCH_S, LEG_EVERY_S)
    at_s = np.array([world.true_time(each_s) for each_s in cut_s.tolist()])
    history = np.array(unit.history)
    drifted_g, moving_g, sensor_c, thermometer_c = (np.interp(at_s, history[:, 0], row) for row in history.T[1:5])
    axis_rad = np.full_like(at_s, np.radians(_axis_deg(world, leg.place, leg.orientation)))
    through = unit.settings.through
    k1 = _scale_factor(unit.truth, sensor_c, through)
    force_g = (np.sin(axis_rad), np.cos(axis_rad), np.zeros_like(axis_rad))
    current_a = unit.truth.current_a(force_g, sensor_c, drifted_g + moving_g)
    output_g = unit.truth.output(current_a, through) / k1 - force_g[0]
    columns = {
        "temperature_c": (thermometer_c, 5),
        "output_g": (output_g, 10),
        "K1": (k1, 4 if through is None else 10),
    }
    return {name: np.round(values, digits).tolist() for name, (values, digits) in columns.items()}


def _scale_factor(truth: UnitTruth, temperature_c: Array, through: Through) -> Array:
    """Half the difference of the outputs at +1 g and -1 g, in the unit of the output per g (equations 1.6)."""
    nothing = np.zeros_like(temperature_c)
    up, down = (
        truth.output(truth.current_a((nothing + g, nothing, nothing), temperature_c, nothing), through) for g in (1, -1)
    )
    return np.asarray((up - down) / 2)


def channel_constants(
    truth: UnitTruth, gravity_mps2: float, axis_deg: Sequence[float], temperature_c: float, drifted_g: float,
    through: Through = None, extra: Sequence[str] = (), by_input_g: Sequence[float] = (),
) -> dict[str, float]:  # fmt: skip
    """True K0 (g), K1 (pulse/s/g), K1_si (pulse/s per m/s²), K2 (g/g²) and misalignment (rad) of a channel.

    `axis_deg` are the ideal angles of the input axis above the horizontal, `drifted_g` what hysteresis, drift and
    warm-up add to the bias, `by_input_g` what the history of the input adds to it at each angle. `through` a load the
    output is in V instead of pulse/s, through an A/D converter in codes or what they are decoded to. With `extra` also
    Kip (g/g²), K3 (g/g³) and the asymmetry.
    """
    angle = np.radians(np.array(axis_deg))
    sine, cosine = np.sin(angle), np.cos(angle)
    force = (sine, cosine, np.zeros_like(angle))
    drifting = drifted_g + (np.array(by_input_g) if len(by_input_g) else np.zeros_like(angle))
    current = truth.current_a(force, np.full_like(angle, temperature_c), drifting)
    further = {"Kip": sine * cosine, "K3": sine**3, "asymmetry": np.abs(sine) / 2}
    design = np.stack([np.ones_like(sine), sine, cosine, sine**2, *(further[name] for name in extra)], axis=-1)
    solution: list[float] = np.linalg.lstsq(design, truth.output(current, through), rcond=None)[0].tolist()
    c0, k1, cosine_term, c2, *others = solution
    found = {"K0": c0 / k1, "K1": k1, "K1_si": k1 / gravity_mps2, "K2": c2 / k1, "misalignment": cosine_term / k1}
    by_sign_of_the_output = {"asymmetry": abs(k1)}
    return found | {
        name: value / by_sign_of_the_output.get(name, k1) for name, value in zip(extra, others, strict=True)
    }

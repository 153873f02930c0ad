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
from simulators.units.imu import SimulatedImu
from simulators.units.settings import ImuPlace, PlaceSettings
from simulators.world import World

Array = NDArray[np.float64]
LEG_EVERY_S = 10.0
STEPPED = {"turned_on_g": -3, "turned_on_scale": -2}  # columns of a unit's history, by name in the truth
LAST_LATCH_S = 0.1  # possibly before the end of a leg; a sample beyond the end is incomplete
# Separable share of a further term above which the angles of a run determine it. For eight angles and more the shares
# are 1, 0.32 and 0.08 to 0.15; for six, one degree off the level, K3 has 0.02 (equations 1.5).
TOWARDS = {"Kip": "misalignment", "Kio": "misalignment_y"}
OWN_PART = 0.15  # of what its axis feels, for a cross coupling; 0.02 near 0°, 90°, …, else 0.5
LEVEL_G = 1e-6  # along an axis that is level
OWN_SHARE = {"Kip": 0.3, "Kio": 0.3, "K3": 0.2, "asymmetry": 0.06}


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


def turning_record(world: World, turns: Sequence[LegAsMeasured]) -> dict[str, Any]:
    """Temperature of each gyro in the middle of acquisitions on a rate table, by place and step."""
    found: dict[str, dict[str, float]] = {}
    for turn in turns:
        if turn.place in world.gyros:
            true_s = world.true_time((turn.begin_s + turn.end_s) / 2)
            history = world.gyros[turn.place].history.around(true_s, true_s)
            history = history[history[:, 0].argsort(kind="stable")]
            found.setdefault(turn.place, {})[turn.key] = float(np.interp(true_s, history[:, 0], history[:, 1]))
    return {"gyros_c": found} if found else {}


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
    forces: dict[str, list[Array]] = {}
    for dwell in dwells:
        forces.setdefault(_run_of(dwell), []).extend(_forces_g(world, dwell))
    extra = {run: separable_terms(np.array(each_g)) for run, each_g in forces.items()}
    return {dwell.key: _dwell(world, dwell, extra[_run_of(dwell)]) for dwell in dwells}


def _run_of(dwell: DwellAsMeasured) -> str:
    return dwell.key.partition("@")[0]


def _forces_g(world: World, dwell: DwellAsMeasured) -> list[Array]:
    """Ideal specific force at each reading of a dwell, along input, output and pendulous axes, each (3,)."""
    unit = world.units[dwell.place]
    return [gravity_in_unit(world, unit, orientation) for orientation in dwell.orientation]


def in_one_plane(axis_deg: Sequence[float]) -> Array:
    """Specific force (n, 3) with the output axis level and the input axis at these angles above the horizontal."""
    angle = np.radians(np.array(axis_deg))
    return np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)


def separable_terms(force_g: Array) -> tuple[str, ...]:
    """Further terms of the model equation that are separable by these specific forces (n, 3).

    Each column is orthogonalised against the previous ones; the remaining length is its separable part. A misalignment
    is a term of its own as soon as its axis has left the level.
    """
    columns, base = _columns(force_g), _base(force_g)
    known, found = [columns[name] for name in base], base[4:]
    for name in OWN_SHARE:
        column, towards = columns[name], columns[TOWARDS.get(name, "K1")]
        if not float(np.linalg.norm(column)) > max(OWN_PART * float(np.linalg.norm(towards)), LEVEL_G):
            continue
        others = np.linalg.qr(np.stack(known, axis=-1))[0]
        own = column - others @ (others.T @ column)
        if np.linalg.norm(own) > OWN_SHARE[name] * np.linalg.norm(column):
            known.append(column)
            found.append(name)
    return tuple(found)


def _columns(force_g: Array) -> dict[str, Array]:
    """Specific force in each term of the model equation."""
    along, across, pendulous = np.array(force_g).T
    return {
        "K0": np.ones_like(along), "K1": along, "misalignment": pendulous, "K2": along**2, "misalignment_y": across,
        "Kip": along * pendulous, "Kio": along * across, "K3": along**3, "asymmetry": np.abs(along) / 2,
    }  # fmt: skip


def _base(force_g: Array) -> list[str]:
    """Terms that are found at any angles: of the misalignments those towards an axis that left the level."""
    columns = _columns(force_g)
    towards = [name for name in ("misalignment", "misalignment_y") if np.linalg.norm(columns[name]) > LEVEL_G]
    return ["K0", "K1", "K2", *(towards or ["misalignment"])]


def _dwell(world: World, dwell: DwellAsMeasured, extra: Sequence[str]) -> dict[str, Any]:
    """State and constants of a unit in the middle of a dwell, with the further terms `extra`."""
    unit, settings = world.units[dwell.place], world.settings
    true_s, each_s = world.true_time(dwell.at_s), [world.true_time(at_s) for at_s in dwell.each_s]
    history = unit.history.around(min([true_s, *each_s]), max([true_s, *each_s]))
    drifted_g = float(np.interp(true_s, history[:, 0], history[:, 1] - history[:, -1]))
    by_input_g = np.interp(each_s, history[:, 0], history[:, -1]).tolist() if history[:, -1].any() else []
    stepped = {name: float(np.interp(true_s, history[:, 0], history[:, column])) for name, column in STEPPED.items()}
    force_g = np.array(_forces_g(world, dwell))
    constants = channel_constants(
        unit.truth, settings.gravity_mps2, force_g, dwell.temperature_c, drifted_g, unit.settings.through, extra,
        by_input_g,
    )  # fmt: skip
    found = {
        "temperature_c": dwell.temperature_c, "drifted_g": drifted_g, "forces_g": force_g.tolist(), **constants
    }  # fmt: skip
    found |= {name: value for name, value in stepped.items() if value}
    found |= {name: constants[name] * (1 + stepped["turned_on_scale"]) for name in ("K1", "K1_si")}
    found |= {"by_input_g": by_input_g} if by_input_g else {}
    return found | ({"extra": list(extra)} if extra else {})


def gravity_in_unit(world: World, unit: SimulatedUnit | SimulatedImu, orientation: Orientation) -> Array:
    """Specific force along input, output and pendulous axes in local g, (3,), on the nominal bench.

    Of an inertial unit along x, y and z.
    """
    angles_deg = [np.array([angle_deg]) for angle_deg in orientation.angles_deg]
    upward = world.settings.fixture.to_fixture(angles_deg)[0, :, 2]
    clock_deg = unit.settings.clock_deg if isinstance(unit, SimulatedUnit) else 0.0
    return np.asarray(to_unit(orientation.mount, unit.settings.mount_angle_deg, clock_deg) @ upward)


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
    history = unit.history.around(true_s, true_s)
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
    history = unit.history.around(world.true_time(leg.begin_s), world.true_time(leg.end_s))
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
    truth: UnitTruth, gravity_mps2: float, force_g: Array, temperature_c: float, drifted_g: float,
    through: Through = None, extra: Sequence[str] = (), by_input_g: Sequence[float] = (),
) -> dict[str, float]:  # fmt: skip
    """True K0 (g), K1 (pulse/s/g), K1_si (pulse/s per m/s²), K2 (g/g²) and misalignment (rad) of a channel.

    `force_g` (n, 3) are the ideal specific forces along input, output and pendulous axes, `drifted_g` what hysteresis,
    drift and warm-up add to the bias, `by_input_g` what the history of the input adds to it at each reading. `through`
    a load the output is in V instead of pulse/s, through an A/D converter in codes or what they are decoded to. With
    `extra` also Kip, Kio (g/g²), K3 (g/g³), the asymmetry, and the misalignment towards the output axis.
    """
    along, across, pendulous = np.array(force_g).T
    drifting = drifted_g + (np.array(by_input_g) if len(by_input_g) else np.zeros_like(along))
    current = truth.current_a((along, pendulous, across), np.full_like(along, temperature_c), drifting)
    columns, base = _columns(force_g), _base(force_g)
    names = [*base, *(name for name in extra if name not in base and np.linalg.norm(columns[name]) > LEVEL_G)]
    design = np.stack([columns[name] for name in names], axis=-1)
    solution: list[float] = np.linalg.lstsq(design, truth.output(current, through), rcond=None)[0].tolist()
    terms = dict(zip(names, solution, strict=True))
    k1 = terms["K1"]
    divided = {name: value / (abs(k1) if name == "asymmetry" else k1) for name, value in terms.items()}
    return divided | {"K1": k1, "K1_si": k1 / gravity_mps2}

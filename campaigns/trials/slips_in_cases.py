"""Slips of people who record data elsewhere: other units, exchanged columns, what is no number. All are seen."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.errors import InputError
from bench.offline.case import reduced_case
from campaigns.trials.rows import Row
from tests.support.any_case import KINDS, GoodCase, good_case

G = 9.80665
REFUSED = "refused"


class Slip(NamedTuple):
    """Alteration of a good case, and the flag expected for it; `REFUSED` for an error of the input."""

    method: str
    sub: str
    name: str
    spoil: Callable[[GoodCase], Any]
    seen: str


def times(column: str, factor: float) -> Callable[[GoodCase], None]:
    """A column in another unit."""

    def spoil(case: GoodCase) -> None:
        case[column] = lambda values: values * factor

    return spoil


def plus(column: str, offset: float) -> Callable[[GoodCase], None]:
    """A column on another scale."""

    def spoil(case: GoodCase) -> None:
        case[column] = lambda values: values + offset

    return spoil


def exchanged(one: str, other: str) -> Callable[[GoodCase], None]:
    """Two columns under each other's names."""
    return lambda case: case.exchange(one, other)


def setting(key: str, factor: float) -> Callable[[GoodCase], None]:
    """A setting in another unit."""

    def spoil(case: GoodCase) -> None:
        case.settings[key] *= factor

    return spoil


def _gravity_in_mps2(case: GoodCase) -> None:
    case.settings["runs"]["up_1g"]["a_g"] = G


def _midnight(case: GoodCase) -> None:
    middle = float(np.median(case["t_s"]))
    case["t_s"] = lambda values: np.where(values < middle, values, values - middle)


def _residual_angle(case: GoodCase) -> None:
    case.settings["mount"] = {"angle3_rad": 0.0573}


def _frozen(case: GoodCase) -> None:
    case["gyro_dps"] = lambda values: np.where(np.arange(len(values)) < len(values) // 2, values, values[0])


def frozen_from_the_middle(column: str) -> Callable[[GoodCase], None]:
    """A column that stays as it was half way."""

    def spoil(case: GoodCase) -> None:
        case[column] = lambda values: np.where(half(column)(case), values[len(values) // 2 - 1], values)

    return spoil


def _frozen_ramp(case: GoodCase) -> None:
    case["U_V"] = lambda values: np.where(np.arange(len(values)) < len(values) // 2, values, values[0])


def _one_increment(case: GoodCase) -> None:
    case["dtheta1_rad"] = lambda values: np.where(np.arange(len(values)) == 4, 206265 * values, values)


def _thousands_of_g(case: GoodCase) -> None:
    case["acc_g"] = lambda values: values / 1000
    case.settings["range_g"] /= 1000


def _full_scale_per_hour(case: GoodCase) -> None:
    case.settings |= {"linearity_basis": "full_scale", "full_scale_dps": 100.0 * 3600}


def _legs_exchanged(case: GoodCase) -> None:
    case.records["ramp"]["leg"] = [{"up": "down", "down": "up"}[name] for name in case.records["ramp"]["leg"]]


def reversed_sign(column: str, which: Callable[[GoodCase], Any]) -> Callable[[GoodCase], None]:
    """A column with the other sign in some rows."""
    return lambda case: case.__setitem__(column, np.where(which(case), -case[column], case[column]))


def half(column: str) -> Callable[[GoodCase], Any]:
    """The later half of the rows of a column."""
    return lambda case: np.arange(len(case[column])) >= len(case[column]) // 2


def some(column: str) -> Callable[[GoodCase], Any]:
    """Half of the rows of a column, drawn."""
    return lambda case: np.random.default_rng(1).random(len(case[column])) < 0.5


def frozen(column: str, which: Callable[[GoodCase], Any] = lambda _: True) -> Callable[[GoodCase], None]:
    """A column that stays in some rows at what it is in the first of them."""

    def spoil(case: GoodCase) -> None:
        rows = np.broadcast_to(which(case), len(case[column]))
        case[column] = np.where(rows, case[column][np.argmax(rows)], case[column])

    return spoil


def down_a_row(column: str) -> Callable[[GoodCase], None]:
    """A column in which every value stands one row too low."""

    def spoil(case: GoodCase) -> None:
        case[column] = lambda values: np.roll(values, 1)

    return spoil


RAD = np.pi / 180
SLIPS = (
    Slip("M0", "", "T_conv in kelvin", plus("T_conv_C", 273.15), "implausible_temperature"),
    Slip("M0", "", "T_conv and T_acc exchanged", exchanged("T_conv_C", "T_acc_C"), "columns_exchanged"),
    Slip("M0", "", "level in m/s²", _gravity_in_mps2, "implausible_scale"),
    Slip("M0", "", "time in ms", times("t_s", 1000), "up_1g:invalid"),
    Slip("M0", "", "time in minutes", times("t_s", 1 / 60), "src_12g:invalid"),
    Slip("M0", "", "counts in thousands", times("cum_pos", 1e-3), "up_1g:invalid"),
    Slip("M1", "", "angles in radians", times("theta_deg", RAD), "implausible_angle"),
    Slip("M1", "", "angles in minutes of arc", times("theta_deg", 60), "implausible_angle"),
    Slip("M1", "", "angle and output exchanged", exchanged("theta_deg", "V_mean"), "columns_exchanged"),
    Slip("M1", "", "output in mV", times("V_mean", 1e3), "implausible_scale"),
    Slip("M1", "", "sign of one end reversed", reversed_sign("V_mean", half("V_mean")), "implausible_scale"),
    Slip("M1", "", "sign of half of the rows reversed", reversed_sign("V_mean", some("V_mean")), "implausible_scale"),
    Slip("M2", "", "sign of half of the rows reversed", reversed_sign("Nx", half("Nx")), "implausible_scale"),
    Slip(
        "M4",
        "static",
        "sign of half of the positions reversed",
        reversed_sign("U_V", lambda case: case["pos_deg"] >= 180),
        "implausible_scale",
    ),
    Slip("M4", "static", "sign of half of the dwells reversed", reversed_sign("U_V", half("U_V")), "implausible_scale"),
    Slip("M4", "static", "output a row too low", down_a_row("U_V"), "implausible_scale"),
    Slip("M1", "", "output in µV", times("V_mean", 1e6), "implausible_output"),
    Slip("M2", "", "rates in rad/s against °/s", times("rate_true_dps", RAD), "implausible_angle"),
    Slip("M2", "", "dwell in ms", times("dwell_s", 1000), "implausible_time"),
    Slip("M2", "", "thermometers in kelvin", plus("Tax", 273.15), "implausible_temperature"),
    Slip("M2", "", "counts of both kinds exchanged", exchanged("Nx", "Wx"), "implausible_scale"),
    Slip("M3", "gyro_range", "encoder in radians", times("enc_deg", RAD), "implausible_angle"),
    Slip("M3", "gyro_range", "encoder in turns", times("enc_deg", 1 / 360), "implausible_angle"),
    Slip("M3", "gyro_range", "output in rad/s", times("out_dps", RAD), "implausible_scale"),
    Slip("M3", "gyro_range", "output in °/h", times("out_dps", 3600), "implausible_scale"),
    Slip("M3", "gyro_range", "time in ms", times("t_s", 1000), "implausible_time"),
    Slip(
        "M3", "gyro_range", "output frozen in the later half", frozen_from_the_middle("out_dps"), "implausible_output"
    ),
    Slip("M3", "acc_range", "output frozen in the later half", frozen_from_the_middle("acc_g"), "implausible_output"),
    Slip("M3", "gyro_range", "encoder and output exchanged", exchanged("enc_deg", "out_dps"), "columns_exchanged"),
    Slip("M3", "acc_range", "encoder in radians", times("enc_deg", RAD), "implausible_scale"),
    Slip("M3", "acc_range", "output in m/s²", times("acc_g", G), "implausible_scale"),
    Slip("M3", "acc_range", "output in mg", times("acc_g", 1000), "implausible_scale"),
    Slip("M3", "acc_range", "time in ms", times("t_s", 1000), "implausible_scale"),
    Slip("M3", "acc_range", "encoder and output exchanged", exchanged("enc_deg", "acc_g"), "implausible_scale"),
    Slip("M3", "gyro_freq", "encoder in radians", times("enc_deg", RAD), "implausible_scale"),
    Slip("M3", "gyro_freq", "output in rad/s", times("gyro_dps", RAD), "implausible_scale"),
    Slip("M3", "gyro_freq", "time in ms", times("t_s", 1000), "implausible_time"),
    Slip("M3", "gyro_freq", "frequency in rad/s", times("f_Hz", 2 * np.pi), "implausible_time"),
    Slip("M3", "gyro_freq", "encoder and output exchanged", exchanged("enc_deg", "gyro_dps"), "columns_exchanged"),
    Slip("M3", "acc_freq", "increments in degrees", times("dtheta_rad", 1 / RAD), "invalid"),
    Slip("M3", "acc_freq", "time in ms", times("t_s", 1000), "implausible_time"),
    Slip("M3", "acc_freq", "interval in ms", setting("Ts_s", 1000), "implausible_time"),
    Slip("M3", "acc_freq", "output in µg", times("acc_g", 1e6), "implausible_scale"),
    *(
        Slip("M3", sub, "time running backwards", times("t_s", -1), "implausible_time")
        for sub in ("gyro_range", "acc_range", "gyro_freq", "acc_freq")
    ),
    Slip("M3", "acc_freq", "clock set back at midnight", _midnight, "implausible_time"),
    Slip("M3", "two_sample", "one increment in seconds of arc", _one_increment, "implausible_angle"),
    Slip("M1", "", "residual angle in degrees", _residual_angle, "implausible_angle"),
    Slip("M3", "acc_range", "gravity in mm/s²", setting("g_mps2", 1000), REFUSED),
    Slip("M3", "acc_freq", "gravity in g", setting("g_mps2", 1 / G), REFUSED),
    Slip(
        "M3",
        "gyro_freq",
        "sign of half of the samples reversed",
        reversed_sign("gyro_dps", some("gyro_dps")),
        "implausible_scale",
    ),
    Slip("M3", "gyro_freq", "output frozen in the later half", _frozen, "implausible_output"),
    Slip("M3", "two_sample", "time of both samples in s for ms", setting("h_s", 1e-3), "implausible_time"),
    Slip("M3", "two_sample", "arm in mm", setting("rx_m", 1000), "implausible_scale"),
    Slip("M4", "tilt", "slope of the bias in mV", setting("B1_V_per_C", 1000), "implausible_scale"),
    Slip("M4", "tilt", "scale factor in mV/g", setting("K1_V_per_g", 1000), "implausible_scale"),
    Slip("M4", "dynamic", "output frozen in the later half", _frozen_ramp, "implausible_output"),
    Slip("M4", "dynamic", "scale factor a thousandfold", setting("K1_V_per_g", 1000), "implausible_scale"),
    Slip("M3", "two_sample", "time of both samples in ms", setting("h_s", 1000), "implausible_time"),
    Slip("M3", "two_sample", "increments in seconds of arc", times("dtheta1_rad", 206265), "implausible_angle"),
    Slip("M4", "static", "positions in radians", times("pos_deg", RAD), "implausible_angle"),
    Slip("M4", "static", "output in mV", times("U_V", 1e3), "implausible_output"),
    Slip("M4", "static", "thermometer in kelvin", plus("T_meas_C", 273.15), "implausible_temperature"),
    Slip("M4", "static", "position and output exchanged", exchanged("pos_deg", "U_V"), "columns_exchanged"),
    Slip("M4", "static", "thermometer and output exchanged", exchanged("T_meas_C", "U_V"), "implausible_temperature"),
    Slip("M4", "dynamic", "output in mV", times("U_V", 1e3), "implausible_scale"),
    Slip("M4", "dynamic", "scale factor in mV/g", setting("K1_V_per_g", 1e-3), "implausible_scale"),
    Slip("M4", "dynamic", "thermometer in kelvin", plus("T_C", 273.15), "implausible_temperature"),
    Slip("M4", "dynamic", "time in ms", times("t_s", 1000), "implausible_time"),
    Slip("M4", "dynamic", "time in hours", times("t_s", 1 / 3600), "implausible_time"),
    Slip("M4", "dynamic", "temperature and output exchanged", exchanged("T_C", "U_V"), "implausible_scale"),
    Slip("M4", "dynamic", "up and down exchanged", _legs_exchanged, "legs_exchanged"),
    Slip("M4", "tilt", "output in mV", times("U_V", 1e3), "implausible_scale"),
    Slip("M1", "", "clocking in mV", times("V", 1e3), "implausible_scale"),
    Slip("M1", "", "clocking frozen", frozen("V"), "implausible_output"),
    Slip("M2", "", "a gyro that counts nothing", times("Wy", 0), "implausible_output"),
    Slip("M3", "acc_range", "output frozen", frozen("acc_g"), "implausible_scale"),
    Slip("M3", "acc_range", "output and range in units of 1000 g", _thousands_of_g, "implausible_scale"),
    Slip("M3", "acc_range", "range in mg", setting("range_g", 1000), "implausible_scale"),
    Slip("M3", "gyro_range", "full scale in °/h", _full_scale_per_hour, "implausible_scale"),
    Slip("M4", "static", "output 0", times("U_V", 0), "implausible_scale"),
    Slip("M4", "static", "thermometer frozen later", frozen("T_meas_C", half("T_meas_C")), "implausible_temperature"),
    Slip("M4", "dynamic", "thermometer frozen later", frozen("T_C", half("T_C")), "implausible_temperature"),
    Slip("M4", "tilt", "output frozen", frozen("U_V"), "implausible_output"),
    Slip("M4", "tilt", "thermometer in kelvin", plus("T_C", 273.15), "implausible_temperature"),
    Slip("M4", "tilt", "temperature and output exchanged", exchanged("T_C", "U_V"), "implausible_scale"),
)


def missed(slip: Slip) -> str:
    """Reason why a mistake is undetected; empty if its flag is set and the case is neither PASS, FAIL nor complete."""
    case = good_case(slip.method, slip.sub)
    slip.spoil(case)
    title = f"{slip.method} {slip.sub} {slip.name}".replace("  ", " ")
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = reduced_case(case.write(Path(folder)))
        except InputError as problem:
            return "" if slip.seen == REFUSED else f"{title}: {problem}"
    if found.outcome == "INCOMPLETE" and any(slip.seen in flag for flag in found.content["flags"]):
        return ""
    return f"{title}: {found.outcome} {found.content['flags']}"


def no_cell_is_trusted(rng: np.random.Generator, method: str, sub: str) -> str:
    """Exceptions other than InputError from a case with a hostile cell; empty if there are none."""
    case = good_case(method, sub)
    record = case.records[rng.choice(list(case.records))]
    column, text = rng.choice(list(record)), str(rng.choice(HOSTILE))
    for row in rng.integers(len(record[column]), size=rng.integers(1, 40)):
        record[column][row] = text
    with tempfile.TemporaryDirectory() as folder:
        try:
            reduced_case(case.write(Path(folder), as_text=ENCODINGS[int(rng.integers(len(ENCODINGS)))]))
        except InputError:
            return ""
        except Exception as problem:  # noqa: BLE001 - whatever it is: that is the finding
            return f"{method} {sub}: {column} = {text!r}: {problem!r}"
    return ""


HOSTILE = (
    "nan",
    "inf",
    "-inf",
    "",
    " ",
    "1e308",
    "-1e308",
    "1e-320",
    "-0",
    "0",
    "1e16",
    "0x10",
    "1,5",
    "x" * 200,
    "１",
    "\x00",
)
ENCODINGS: tuple[Callable[[str], bytes], ...] = (
    str.encode,
    lambda text: b"\xef\xbb\xbf" + text.encode(),
    lambda text: text.replace("\n", "\r\n").encode(),
    lambda text: text.replace("\n", "\n\n").encode(),
    lambda text: text.replace(",", ";").encode(),
    lambda text: text.encode("utf-16"),
)


def trials(scale: float) -> Iterator[Row]:
    """All slips, and hostile cells in cases of every kind."""
    slips = SLIPS[:: max(1, round(1 / scale))]
    unseen = [found for found in map(missed, slips) if found]
    yield Row("slips in units and columns of cases", len(slips), "; ".join(unseen) or "each is flagged", not unseen)
    rng = np.random.default_rng(20_261_123)
    rounds = max(1, round(60 * scale))
    broken = [found for kind in KINDS for _ in range(rounds) if (found := no_cell_is_trusted(rng, *kind))]
    result = "; ".join(broken[:3]) or "none raises anything but an input error"
    yield Row("hostile cells in records of cases", rounds * len(KINDS), result, not broken)

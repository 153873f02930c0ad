"""Units that differ in kind from the shipped ones: each kind is a small change of the document of a unit file.

A number in it is a quantity, or `{mean, sd}` of what is drawn by the seed. Kinds multiply what is there, so that
they fit a micro-gravity sensor and a 20 g sensor alike, and set what is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

from bench.config.document import read_document

Part = dict[str, Any]
Change = Callable[[Part], None]
# By which units of a kind differ where the file fixes them.
ACCELEROMETER_SD = {"K0": "0.1 mg", "K1": "1 µA/g"}
GYRO_SD = {"D0": "0.5 °/h"}
PER_DEGREE_SD = "60 ppm/°C"  # of a scale factor, as ranges and responses state it where they do not find it


def times(quantity: Any, factor: float) -> Any:
    """A quantity, or the `{mean, sd}` of one, so many times as large."""
    if isinstance(quantity, dict):
        sd = times(quantity["sd"], abs(factor))
        return {"mean": times(quantity["mean"], factor), "sd": sd}
    number, _, unit = str(quantity).partition(" ")
    return f"{float(number) * factor:g} {unit}".strip()


def _multiply(part: Part, otherwise: dict[str, str], **factors: float) -> None:
    """Multiplies members of a part of a document; one that is not there becomes what `otherwise` has."""
    for name, factor in factors.items():
        part[name] = times(part[name], factor) if name in part else otherwise[name]


# Changes of an accelerometer and its converter


def _negative(unit: Part) -> None:
    _multiply(unit["accelerometer"]["K1"], {}, at_reference=-1)


def _hysteresis(unit: Part) -> None:
    known = unit["accelerometer"].get("hysteresis", {"amplitude": "60 µg", "thresholds": ["5 °C", "10 °C", "20 °C"]})
    unit["accelerometer"]["hysteresis"] = known | {"amplitude": times(known["amplitude"], 5)}


def _misaligned(unit: Part) -> None:
    part = unit["accelerometer"]
    far = 4 if isinstance(part.get("misalignment_o"), dict) else 20  # one that is drawn is of a narrow range
    _multiply(part, {"misalignment_o": "6 mrad", "misalignment_p": "-10 mrad"}, misalignment_o=far, misalignment_p=far)


def _warm(unit: Part) -> None:
    part = unit["accelerometer"]
    _multiply(part["K0"], {"quadratic": "0.1 µg/°C²"}, linear=5, quadratic=3)
    _multiply(part["K1"], {}, linear=-2)
    _multiply(part, {"Kd": "-30 µg·min/°C"}, Kd=3)


def _noisy(unit: Part) -> None:
    _multiply(unit["accelerometer"]["noise"], {}, density=10, instability=10)


def _nonlinear(unit: Part) -> None:
    otherwise = {"K3": "5 µg/g³", "Kip": "100 µg/g²", "Kio": "100 µg/g²"}
    _multiply(unit["accelerometer"], otherwise, K2=10, K3=100, Kip=20, Kio=20)
    _multiply(unit["converter"], {"asymmetry": "300 ppm", "nonlinearity": "300 ppm"}, asymmetry=10, nonlinearity=10)


# Changes of a gyro, which has no hysteresis: of g-sensitivity instead, and of its dynamics


def _negative_gyro(gyro: Part) -> None:
    _multiply(gyro["KG"], {}, at_reference=-1)


def _g_sensitive_gyro(gyro: Part) -> None:
    _multiply(gyro["g_sensitivity"], {}, input=20, pendulous=20, output=20)


def _misaligned_gyro(gyro: Part) -> None:
    _multiply(gyro, {}, misalignment_o=20, misalignment_p=20)


def _warm_gyro(gyro: Part) -> None:
    _multiply(gyro["D0"], {}, linear=10)
    _multiply(gyro["KG"], {}, linear=5)


def _noisy_gyro(gyro: Part) -> None:
    _multiply(gyro["noise"], {}, random_walk=10, instability=10)


def _nonlinear_gyro(gyro: Part) -> None:
    _multiply(gyro, {"q3": "2e-9 s²/°²"}, asymmetry=10, q3=20)


def _slow(part: Part) -> None:
    part |= {"bandwidth": "40 Hz", "damping": 0.9, "delay": "5 ms"}


ACCELEROMETER: dict[str, Change] = {
    "as shipped": lambda _: None, "negative scale": _negative, "hysteresis": _hysteresis, "misaligned": _misaligned,
    "warm": _warm, "noisy": _noisy, "nonlinear": _nonlinear,
}  # fmt: skip
GYRO: dict[str, Change] = {
    "as shipped": lambda _: None, "negative scale": _negative_gyro, "g-sensitive": _g_sensitive_gyro,
    "misaligned": _misaligned_gyro, "warm": _warm_gyro, "noisy": _noisy_gyro, "nonlinear": _nonlinear_gyro,
}  # fmt: skip
INERTIAL = {"hysteresis": "g-sensitive"}  # what a kind of accelerometer is of a gyro in the same unit


def altered(document: Part, kind: str) -> Part:
    """The document of a unit file of another kind; it is changed in place."""
    if "accelerometers" in document:
        _alter_inertial(document, kind)
    elif "gyro" in document:
        _slow(document["gyro"]) if kind == "slow" else GYRO[kind](document["gyro"])
    elif kind == "slow":
        _slow(document["accelerometer"])
    else:
        ACCELEROMETER[kind](document)
    if kind == "warm":
        document["thermal"]["self_heating"] = "15 °C"
    for part in _parts(document, "accelerometer"):
        _draw(part, ACCELEROMETER_SD)
        if "damping" in part:  # for rate tables
            part["K1"]["linear"] = {"mean": "0 ppm/°C", "sd": PER_DEGREE_SD}
    for part in _parts(document, "gyro"):
        _draw(part, GYRO_SD)
        if "damping" in part:
            part["KG"]["linear"] = {"mean": "0 ppm/°C", "sd": times(PER_DEGREE_SD, 5 if kind == "warm" else 1)}
    return document


def _alter_inertial(document: Part, kind: str) -> None:
    for name in "xyz":
        part = document["accelerometers"][name]
        if kind == "misaligned":
            _misalign_matrix(document["accelerometers"]["misalignment"][name])
            _misalign_matrix(document["gyros"]["misalignment"][name])
        else:
            ACCELEROMETER[kind]({"accelerometer": part, "converter": part["converter"]})
            GYRO[INERTIAL.get(kind, kind)](document["gyros"][name])


def _misalign_matrix(row: Part) -> None:
    _multiply(row, {}, **dict.fromkeys(row, 10))


def _parts(document: Part, kind: str) -> Iterator[Part]:
    """Every accelerometer, or every gyro, of a unit."""
    if kind in document:
        yield document[kind]
    yield from (document[f"{kind}s"][name] for name in "xyz" if f"{kind}s" in document)


def _draw(part: Part, sds: dict[str, str]) -> None:
    """Make bias and scale factor differ from seed to seed.

    What is left over in a converter when it is latched follows from the rate: one unit for all seeds would have the
    same errors of counting in all.
    """
    for name, sd in sds.items():
        known = part[name]["at_reference"]
        if not isinstance(known, dict):
            part[name]["at_reference"] = {"mean": known, "sd": sd}


def kinds_of(path: Path) -> list[str]:
    """The kinds that a unit file can be altered to."""
    document = read_document(path).value
    return list(GYRO if "gyro" in document else ACCELEROMETER)


def alter_file(path: Path, kind: str) -> None:
    """Write the unit file of another kind in place of a unit file."""
    document = altered(read_document(path).value, kind)
    with path.open("w", encoding="utf-8") as file:
        yaml.safe_dump(document, file, allow_unicode=True)

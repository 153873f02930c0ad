r"""Units of D-SI, such as `\\milli\\volt\\second\\tothe{-1}`, and those of this project, in both directions.

Two units of this project are not of the SI. Pulses and codes are counts, `\\one` in D-SI. `g` is local gravity: a value
in it is converted by the value of the site (docs/decisions/0129). D-SI: https://doi.org/10.5281/zenodo.3522630; the
names are those of the SI brochure, 9th edition, in the notation of the LaTeX package siunitx.
"""

from __future__ import annotations

import re
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

from drivers.quantity.units import NO_DIMENSION, QuantityError, Unit, factors, parse_unit, quoted

ONE = r"\one"
_PREFIXES = {"n": r"\nano", "µ": r"\micro", "u": r"\micro", "m": r"\milli", "k": r"\kilo", "M": r"\mega"}
_NAMES = {
    "s": r"\second", "m": r"\metre", "A": r"\ampere", "V": r"\volt", "W": r"\watt", "Ω": r"\ohm", "ohm": r"\ohm",
    "Hz": r"\hertz", "rad": r"\radian", "arcsec": r"\arcsecond", "N": r"\newton", "Pa": r"\pascal", "min": r"\minute",
    "h": r"\hour", "day": r"\day", "d": r"\day", "°": r"\degree", "deg": r"\degree", "arcmin": r"\arcminute",
    "hPa": r"\hecto\pascal", "%": r"\percent", "ppm": r"\ppm", "kg": r"\kilogram",
}  # fmt: skip
_COUNTS = ("pulse", "code", "LSB", "1")
_CELSIUS = ("°C", "degC")
_OTHERS = {"turn": ("°", 360), "rpm": ("°/s", 6)}  # not in D-SI: their equal, and its number
_GRAVITY = {r"\metre": 1.0, r"\second": -2.0}

# of certificates: the equal of this project
_READ = {
    "metre": "m", "kilogram": "kg", "second": "s", "ampere": "A", "kelvin": "°C", "one": "1", "degreecelsius": "°C",
    "day": "day", "hour": "h", "minute": "min", "degree": "°", "arcminute": "arcmin", "arcsecond": "arcsec",
    "radian": "rad", "hertz": "Hz", "newton": "N", "pascal": "Pa", "joule": "N·m", "watt": "W", "volt": "V",
    "coulomb": "A·s", "ohm": "Ω", "percent": "%", "ppm": "ppm",
}  # fmt: skip
_POWERS_OF_TEN = {
    "giga": 9, "mega": 6, "kilo": 3, "hecto": 2, "deca": 1, "deci": -1, "centi": -2, "milli": -3, "micro": -6,
    "nano": -9, "pico": -12,
}  # fmt: skip
_TOKEN = re.compile(r"\\(?P<name>[a-z]+)(?:\\tothe\{(?P<power>[-+]?\d+(?:\.\d+)?)\})?", re.ASCII)
_LONGEST = 200


class Written(NamedTuple):
    """Unit in D-SI: value in it = value · `factor` · g^`gravity`, g the value of local gravity in m/s²."""

    text: str
    factor: Fraction
    gravity: float


class Read(NamedTuple):
    """Unit of a certificate as one of this project; a temperature in it is one of kelvin if `is_kelvin`."""

    unit: Unit
    is_kelvin: bool


@lru_cache(maxsize=256)
def written(unit: str, *, g_is_one: bool = False) -> Written:
    """Return a unit in D-SI. Temperatures alone are in degrees Celsius, intervals and their powers in kelvin.

    With `g_is_one`, values remain relative to local gravity. Raises QuantityError for what is no unit.
    """
    powers, factor, gravity = dict[str, float](), Fraction(1), 0.0
    parts = factors(unit)
    alone = len(parts) == 1 and parts[0].power == 1
    for symbol, _, power in parts:
        equal, number = _OTHERS.get(symbol, (symbol, 1))
        factor *= Fraction(number) ** int(power) if number != 1 else 1
        for each in factors(equal):
            steps = _steps(each.symbol, alone=alone)
            if steps is None:
                factor *= _scale_of_g(each.symbol, power)
                gravity += 0.0 if g_is_one else power
                steps = {} if g_is_one else _GRAVITY
            for name, step in steps.items():
                powers[name] = powers.get(name, 0.0) + step * power * each.power
    text = "".join(_raised(name, power) for name, power in powers.items() if power)
    return Written(text or ONE, factor, gravity)


def _steps(symbol: str, *, alone: bool) -> dict[str, float] | None:
    r"""Return the names of a symbol with their exponents, such as {`\milli\ampere`: 1}; None for local gravity."""
    if symbol in _COUNTS:
        return {}
    if symbol in _CELSIUS:
        return {r"\degreecelsius" if alone else r"\kelvin": 1.0}
    if symbol in _NAMES:
        return {_NAMES[symbol]: 1.0}
    prefix, rest = symbol[0], symbol[1:]
    if symbol == "g" or rest == "g":
        return None
    if rest in _NAMES:
        return {_PREFIXES[prefix] + _NAMES[rest]: 1.0}
    raise QuantityError(f"{quoted(symbol)} cannot be written in D-SI")


def _scale_of_g(symbol: str, power: float) -> Fraction:
    """Return the number of a multiple of local gravity, such as µg."""
    return Fraction(parse_unit(symbol).factor ** (int(power) if power == int(power) else power))


def _raised(name: str, power: float) -> str:
    return name if power == 1 else rf"{name}\tothe{{{power:g}}}"


def read(text: str) -> Read:
    r"""Return the unit of a D-SI text, such as `\micro\volt\per\volt`. Raises QuantityError.

    Of a text with alternatives, `\milli\volt|\volt…`, the first counts; they are equal.
    """
    given = text.strip().partition("|")[0]
    if len(given) > _LONGEST:
        raise QuantityError(f"{quoted(given)} is too long for a unit")
    unit, at, names = Unit(Fraction(1), NO_DIMENSION), 0, list[tuple[str, float]]()
    ten, sign = Fraction(1), 1.0
    while at < len(given):
        match = _TOKEN.match(given, at)
        if match is None:
            raise QuantityError(f"{quoted(given)} is not a unit of D-SI")
        name, power, at = match["name"], sign * float(match["power"] or 1), match.end()
        if name == "per":
            sign = -1.0
            continue
        if name in _POWERS_OF_TEN:
            ten *= Fraction(10) ** _POWERS_OF_TEN[name]
            continue
        if name not in _READ:
            raise QuantityError(rf"{quoted(given)} has the unit \{name}, which this program does not know")
        base = parse_unit(_READ[name])
        unit = unit * Unit(base.factor * ten, base.dimension) ** power
        names.append((name, power))
        ten, sign = Fraction(1), 1.0
    if not names or ten != 1 or sign != 1:
        raise QuantityError(f"{quoted(given)} is not a unit of D-SI")
    return Read(unit, names == [("kelvin", 1.0)])

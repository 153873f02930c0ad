"""Units of measure: "°C/min", "pulse/s/(m/s²)", "2 µg/Hz^0.5" without its number.

A unit is an exact factor and the exponents of nine base units. Degrees Celsius are a base unit: temperatures and
temperature differences have the same unit, so kelvin and fahrenheit are rejected. `g` is local gravity, a base unit
too, because its value in m/s² depends on the site.
"""

from __future__ import annotations

import math
import re
import reprlib
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

BASES = ("s", "m", "kg", "A", "°C", "°", "g", "pulse", "code")
Dimension = tuple[float, ...]
NO_DIMENSION: Dimension = (0.0,) * len(BASES)
_EXPONENT_LIMIT = 9
_EXPONENT_DECIMALS = 4


class QuantityError(ValueError):
    """Text that is not a quantity, or quantities with incompatible units."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A factor to the base units, exact where it is a ratio of whole numbers, and the exponents of `BASES`."""

    factor: Fraction
    dimension: Dimension

    def __mul__(self, other: Unit) -> Unit:
        powers = dimension_of(a + b for a, b in zip(self.dimension, other.dimension, strict=True))
        return Unit(self.factor * other.factor, powers)

    def __pow__(self, power: float) -> Unit:
        exact = int(power) if power == int(power) else power
        return Unit(Fraction(self.factor**exact), dimension_of(p * power for p in self.dimension))


def dimension_of(powers: Iterable[float]) -> Dimension:
    """Dimension with these exponents of `BASES`; QuantityError for exponents that cannot be written in a unit."""
    exact = tuple(powers)
    rounded = tuple(round(power, _EXPONENT_DECIMALS) for power in exact)
    if any(abs(power) > _EXPONENT_LIMIT for power in rounded):
        raise QuantityError(f"has a unit with an exponent beyond {_EXPONENT_LIMIT}")
    if any(abs(power - near) > 1e-9 for power, near in zip(exact, rounded, strict=True)):
        raise QuantityError(f"has a unit with an exponent of more than {_EXPONENT_DECIMALS} decimals")
    return rounded


def _unit(factor: float | Fraction, **powers: float) -> Unit:
    spelled = {"degC": "°C", "deg": "°"}
    table = {spelled.get(name, name): float(power) for name, power in powers.items()}
    return Unit(Fraction(factor), tuple(table.get(base, 0.0) for base in BASES))


_ONE = _unit(1)

# Symbols that take an SI prefix, and those that do not.
_PREFIXABLE = {
    "s": _unit(1, s=1),
    "m": _unit(1, m=1),
    "A": _unit(1, A=1),
    "V": _unit(1, kg=1, m=2, s=-3, A=-1),
    "W": _unit(1, kg=1, m=2, s=-3),
    "Ω": _unit(1, kg=1, m=2, s=-3, A=-2),
    "ohm": _unit(1, kg=1, m=2, s=-3, A=-2),
    "Hz": _unit(1, s=-1),
    "g": _unit(1, g=1),
    "rad": _unit(180 / math.pi, deg=1),
    "arcsec": _unit(Fraction(1, 3600), deg=1),
    "pulse": _unit(1, pulse=1),
    "N": _unit(1, kg=1, m=1, s=-2),
    "Pa": _unit(1, kg=1, m=-1, s=-2),
}
_PLAIN = {
    "min": _unit(60, s=1),
    "h": _unit(3600, s=1),
    "day": _unit(86400, s=1),
    "d": _unit(86400, s=1),
    "°C": _unit(1, degC=1),
    "degC": _unit(1, degC=1),
    "°": _unit(1, deg=1),
    "deg": _unit(1, deg=1),
    "arcmin": _unit(Fraction(1, 60), deg=1),
    "turn": _unit(360, deg=1),
    "rpm": _unit(6, deg=1, s=-1),
    "hPa": _unit(100, kg=1, m=-1, s=-2),
    "%": _unit(Fraction(1, 100)),
    "ppm": _unit(Fraction(1, 10**6)),
    "kg": _unit(1, kg=1),
    "code": _unit(1, code=1),
    "LSB": _unit(1, code=1),
    "1": _ONE,
}
_PREFIXES = {
    "n": _unit(Fraction(1, 10**9)),
    "µ": _unit(Fraction(1, 10**6)),
    "u": _unit(Fraction(1, 10**6)),
    "m": _unit(Fraction(1, 1000)),
    "k": _unit(1000),
    "M": _unit(10**6),
}
_REFUSED = {
    "K": "kelvin is refused: write °C, for a difference too",
    "°K": "kelvin is refused: write °C, for a difference too",
    "°F": "fahrenheit is refused: write °C",
    "F": "fahrenheit is refused: write °C",
    "gn": "g_n is refused: g is local gravity, or write m/s²",
    "g_n": "g_n is refused: g is local gravity, or write m/s²",
    "gram": "gram is refused: g is local gravity",
    '"': "write arcsec for seconds of arc, or degrees before them like 0°00'05\"",
    "'": "write arcmin for minutes of arc",
}

_WITH_MEGA = ("Hz", "Ω", "ohm", "pulse", "Pa")  # for others a prefix of a million is a typing error for milli

_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_SUPERSCRIPT_RUN = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+")
_SAME = (("º", "°"), ("˚", "°"))  # before NFKC, which would decompose them
_ALIKE = (("−", "-"), ("′′", '"'), ("′", "'"), ("μ", "µ"), ("⋅", "·"))
_TOKEN = re.compile(r"\s*(?:(1(?!\d))|([^\s\d·*/^()+.,-]+)|([·*/()]))", re.ASCII)
_EXPONENT = re.compile(r"\^\(-?\d+(?:\.\d+)?\)|\^?-?\d+(?:\.\d+)?", re.ASCII)
_APART = re.compile(r"°\s+C\b", re.ASCII)
_LENGTH_LIMIT = 200
_SHOWN = reprlib.Repr()
_SHOWN.maxstring = 60


def quoted(text: object) -> str:
    """Quote text for a message, on one line, shortened in the middle if long."""
    return _SHOWN.repr(str(text))


def normalise(text: str) -> str:
    """Unify the spellings of keyboards and word processors: NFKC, ASCII minus, `^2` for ².

    Raises QuantityError for circled digits, subscripts and fractions, which NFKC would merge with neighbouring digits,
    and for text far longer than any quantity.
    """
    if len(text) > _LENGTH_LIMIT:
        raise QuantityError(f"{quoted(text)} is too long for a quantity")
    text = _SUPERSCRIPT_RUN.sub(lambda run: "^" + run.group().translate(_SUPERSCRIPTS), text)
    for char in text:
        if unicodedata.numeric(char, None) is not None and unicodedata.decimal(char, None) is None:
            raise QuantityError(f"{quoted(text)} contains {quoted(char)}; write plain digits")
    for seen, meant in _SAME:
        text = text.replace(seen, meant)
    text = unicodedata.normalize("NFKC", text)
    for seen, meant in _ALIKE:
        text = text.replace(seen, meant)
    return text.strip()


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """Parse a unit, "" for a ratio; a `/` divides by the one factor or parenthesis after it."""
    unit = _ONE
    for factor in factors(text):
        unit = unit * factor.unit**factor.power
    return unit


class Factor(NamedTuple):
    """Factor of a unit: a symbol as written, such as mA, the unit that it stands for, and its exponent."""

    symbol: str
    unit: Unit
    power: float


def factors(text: str) -> list[Factor]:
    """Parse a unit to its factors in the order of the text, "" for a ratio to none."""
    clean = normalise(text)
    if not clean:
        return []
    found, rest = _product(clean, text)
    if rest:
        joined = _APART.sub("°C", clean)
        raise QuantityError(f"{quoted(text)} is not a unit{f'; write {joined}' if joined != clean else ''}")
    return found


def _product(rest: str, text: str) -> tuple[list[Factor], str]:
    """Parse factors up to the end or a closing parenthesis; return the rest."""
    found, operator = list[Factor](), "·"
    while True:
        more, rest = _factor(rest, text)
        found += [each._replace(power=-each.power) for each in more] if operator == "/" else more
        match = _TOKEN.match(rest)
        if match is None or match[3] not in ("·", "*", "/"):
            return found, rest
        operator, rest = match[3], rest[match.end() :]


def _factor(rest: str, text: str) -> tuple[list[Factor], str]:
    match = _TOKEN.match(rest)
    if match is None or not (match[1] or match[2] or match[3] == "("):
        raise QuantityError(f"{quoted(text)} is not a unit")
    rest = rest[match.end() :]
    if match[3] == "(":
        found, rest = _product(rest, text)
        if not rest.startswith(")"):
            raise QuantityError(f"{quoted(text)} lacks a closing parenthesis")
        return found, rest[1:]
    unit = _ONE if match[1] else _symbol(match[2], text)
    exponent = _EXPONENT.match(rest)
    power = float(exponent[0].strip("^()")) if exponent is not None else 1.0
    if abs(power) > _EXPONENT_LIMIT:
        raise QuantityError(f"{quoted(text)} has an exponent beyond {_EXPONENT_LIMIT}")
    return [Factor(match[1] or match[2], unit, power)], rest if exponent is None else rest[exponent.end() :]


_SPELLED_OUT = {
    "second": "s", "sec": "s", "sek": "s", "minute": "min", "hour": "h", "hr": "h", "volt": "V", "amp": "A",
    "ampere": "A", "milliamp": "mA", "milliampere": "mA", "millivolt": "mV", "ohm": "Ω", "degree": "°", "grad": "°",
    "celsius": "°C", "c": "°C", "centigrade": "°C", "hertz": "Hz", "radian": "rad", "percent": "%",
    "arcsecond": "arcsec", "arcminute": "arcmin", "millisecond": "ms",
}  # fmt: skip


def _symbol(symbol: str, text: str) -> Unit:
    known = _PLAIN.get(symbol) or _PREFIXABLE.get(symbol)
    if known is not None:
        return known
    prefix, rest = _PREFIXES.get(symbol[:1]), symbol[1:]
    if prefix is not None and rest in _PREFIXABLE:
        if symbol[0] == "M" and rest not in _WITH_MEGA:
            raise QuantityError(f"{quoted(symbol)} is refused, M being mega: write m{rest} for milli")
        return prefix * _PREFIXABLE[rest]
    if refused := _REFUSED.get(symbol) or (_REFUSED.get(rest) if prefix is not None else None):
        raise QuantityError(refused)
    inside = "" if symbol == text.strip() else f" in {quoted(text)}"
    meant = _meant(symbol)
    raise QuantityError(f"{quoted(symbol)}{inside} is not a known unit{f'; write {meant}' if meant else ''}")


def _meant(symbol: str) -> str:
    """Unit likely meant by a full name, or by a symbol in other case, milli before mega; empty if none is near."""
    name = symbol.casefold()
    for candidate in (name, name.removesuffix("s")):
        if candidate in _SPELLED_OUT:
            return _SPELLED_OUT[candidate]
    prefixed = (prefix + unit for prefix in sorted(_PREFIXES, key="M".__eq__) for unit in _PREFIXABLE)
    every = (*_PLAIN, *_PREFIXABLE, *prefixed)
    return next(
        (known for wanted in (name, name.removesuffix("s")) for known in every if known.casefold() == wanted), ""
    )


# Customary unit of a dimension; the first that fits.
_CUSTOMARY = (
    "", "s", "°C", "°", "A", "V", "m", "g", "pulse", "code", "°C/min", "°/s", "°/s²", "Hz", "m/s²", "pulse/s", "Ω", "W",
    "Pa", "N",
)  # fmt: skip


def customary_unit(dimension: Dimension) -> str:
    """Customary unit of a dimension: "°C/min", "" for a ratio; `base_unit` if there is none."""
    for unit in _CUSTOMARY:
        if parse_unit(unit).dimension == dimension:
            return unit
    return base_unit(dimension)


def base_unit(dimension: Dimension) -> str:
    """Format a dimension as a product of base units."""
    powers = list(zip(BASES, dimension, strict=True))
    above = "·".join(_power(base, power) for base, power in powers if power > 0) or "1"
    return above + "".join("/" + _power(base, -power) for base, power in powers if power < 0)


def _power(base: str, power: float) -> str:
    return base if power == 1 else f"{base}^{power:g}"


def describe(dimension: Dimension) -> str:
    """Describe a dimension for a message: "°C/min", or "a bare number"."""
    return customary_unit(dimension) or "a bare number"


def taken_for_angle(found: Dimension, expected: Dimension) -> bool:
    """Return whether two dimensions differ only in degrees of angle instead of °C."""
    angle, temperature = BASES.index("°"), BASES.index("°C")
    powers = list(found)
    powers[angle], powers[temperature] = powers[temperature], powers[angle]
    return found[angle] != 0 and tuple(powers) == expected


def in_unit(unit: str) -> str:
    """Name of a value in `unit` for a message."""
    return f"a quantity in {unit}" if unit not in ("", "1") else "a number without a unit"

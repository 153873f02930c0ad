r"""Numbers with units: "30 min", "-40 °C", "54°44'08\"", "2 µg/Hz^0.5".

One full-match grammar and an algebra of dimensions; text that is not wholly understood is refused, never guessed at.
What was written is kept: `6 °C/h` and `0.1 °C/min` are the same quantity to the last bit, and `to` gives 6 and 0.1.
Degrees Celsius are a plain unit: a temperature and a difference are written alike, which is why kelvin and
fahrenheit are refused. `g` is local gravity, a dimension of its own, since only a site can turn it into m/s².
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

BASES = ("s", "m", "kg", "A", "°C", "°", "g", "pulse")
Dimension = tuple[float, ...]
NO_DIMENSION: Dimension = (0.0,) * len(BASES)


class QuantityError(ValueError):
    """Text that is not a quantity, or quantities whose units do not go together."""


def _dimension(**powers: float) -> Dimension:
    spelled = {"degC": "°C", "deg": "°"}
    table = {spelled.get(name, name): float(power) for name, power in powers.items()}
    return tuple(table.get(base, 0.0) for base in BASES)


@dataclass(frozen=True, slots=True)
class Unit:
    """A factor to the base units, exact where it is a ratio of whole numbers, and the exponents of `BASES`."""

    factor: Fraction
    dimension: Dimension

    def __mul__(self, other: Unit) -> Unit:
        powers = tuple(a + b for a, b in zip(self.dimension, other.dimension, strict=True))
        return Unit(self.factor * other.factor, powers)

    def __pow__(self, power: float) -> Unit:
        exact = int(power) if power == int(power) else power
        return Unit(Fraction(self.factor**exact), tuple(p * power for p in self.dimension))


_ONE = Unit(Fraction(1), NO_DIMENSION)
_ANGLE = _dimension(deg=1)
_TIME = _dimension(s=1)
_VOLT = _dimension(kg=1, m=2, s=-3, A=-1)

# Symbols that take an SI prefix, and those that do not.
_PREFIXABLE = {
    "s": Unit(1, _TIME),
    "m": Unit(1, _dimension(m=1)),
    "A": Unit(1, _dimension(A=1)),
    "V": Unit(1, _VOLT),
    "W": Unit(1, _dimension(kg=1, m=2, s=-3)),
    "Ω": Unit(1, _dimension(kg=1, m=2, s=-3, A=-2)),
    "ohm": Unit(1, _dimension(kg=1, m=2, s=-3, A=-2)),
    "Hz": Unit(1, _dimension(s=-1)),
    "g": Unit(1, _dimension(g=1)),
    "rad": Unit(180 / math.pi, _ANGLE),
    "arcsec": Unit(1 / 3600, _ANGLE),
    "pulse": Unit(1, _dimension(pulse=1)),
}
_PLAIN = {
    "min": Unit(60, _TIME),
    "h": Unit(3600, _TIME),
    "day": Unit(86400, _TIME),
    "d": Unit(86400, _TIME),
    "°C": Unit(1, _dimension(degC=1)),
    "degC": Unit(1, _dimension(degC=1)),
    "°": Unit(1, _ANGLE),
    "deg": Unit(1, _ANGLE),
    "arcmin": Unit(1 / 60, _ANGLE),
    "turn": Unit(360, _ANGLE),
    "rpm": Unit(6, _dimension(deg=1, s=-1)),
    "%": Unit(1e-2, NO_DIMENSION),
    "ppm": Unit(1e-6, NO_DIMENSION),
    "kg": Unit(1, _dimension(kg=1)),
    "1": _ONE,
}
_PREFIXES = {"n": 1e-9, "µ": 1e-6, "u": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}
_REFUSED = {
    "K": "kelvin is refused: write °C, for a difference too",
    "°F": "fahrenheit is refused: write °C",
    "F": "fahrenheit is refused: write °C",
    "gn": "g_n is refused: g is local gravity, or write m/s²",
    "gram": "gram is refused: g is local gravity",
    '"': "write arcsec for seconds of arc, or degrees before them like 0°00'05\"",
    "'": "write arcmin for minutes of arc",
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """A finite number in base units with its dimension; `+ - * /` and comparison check dimensions."""

    base_value: float
    dimension: Dimension = NO_DIMENSION

    def to(self, unit: str) -> float:
        """The number in `unit`; QuantityError when the dimensions differ."""
        target = parse_unit(unit)
        if target.dimension != self.dimension:
            raise QuantityError(f"is {describe(self.dimension)}, expected a quantity in {unit or 'no unit'}")
        return _plain(self.base_value / target.factor)

    def _same(self, other: object, verb: str) -> Quantity:
        value = as_quantity(other)
        if value.dimension != self.dimension:
            raise QuantityError(f"cannot {verb} {describe(self.dimension)} and {describe(value.dimension)}")
        return value

    def _scaled(self, other: object, power: int) -> Quantity:
        value = as_quantity(other)
        if power < 0 and value.base_value == 0:
            raise QuantityError("division by zero")
        powers = tuple(a + power * b for a, b in zip(self.dimension, value.dimension, strict=True))
        return finite(self.base_value * value.base_value**power, powers)

    def __add__(self, other: object) -> Quantity:
        return finite(self.base_value + self._same(other, "add").base_value, self.dimension)

    def __sub__(self, other: object) -> Quantity:
        return finite(self.base_value - self._same(other, "subtract").base_value, self.dimension)

    def __mul__(self, other: object) -> Quantity:
        return self._scaled(other, 1)

    def __truediv__(self, other: object) -> Quantity:
        return self._scaled(other, -1)

    def __radd__(self, other: object) -> Quantity:
        return as_quantity(other) + self

    def __rsub__(self, other: object) -> Quantity:
        return as_quantity(other) - self

    def __rmul__(self, other: object) -> Quantity:
        return self * other

    def __rtruediv__(self, other: object) -> Quantity:
        return as_quantity(other) / self

    def __neg__(self) -> Quantity:
        return Quantity(-self.base_value, self.dimension)

    def __pos__(self) -> Quantity:
        return self

    def __abs__(self) -> Quantity:
        return Quantity(abs(self.base_value), self.dimension)

    def __lt__(self, other: object) -> bool:
        return self.base_value < self._same(other, "compare").base_value

    def __le__(self, other: object) -> bool:
        return self.base_value <= self._same(other, "compare").base_value

    def __gt__(self, other: object) -> bool:
        return self.base_value > self._same(other, "compare").base_value

    def __ge__(self, other: object) -> bool:
        return self.base_value >= self._same(other, "compare").base_value

    def __str__(self) -> str:
        return spell(self)


def finite(base_value: float, dimension: Dimension) -> Quantity:
    """A quantity; QuantityError when the number is infinite or not a number."""
    if not math.isfinite(base_value):
        raise QuantityError("is not a finite number")
    return Quantity(base_value, dimension)


def as_quantity(value: object) -> Quantity:
    """A quantity as it is, or a bare number as a ratio; anything else is refused."""
    if isinstance(value, Quantity):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return finite(float(value), NO_DIMENSION)
    raise QuantityError(f"'{value}' is not a quantity")


_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_SUPERSCRIPT_RUN = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+")
_QUANTITY = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s].*)?", re.ASCII)
_SEXAGESIMAL = re.compile(r"([+-]?)(\d+)°\s*(?=\d)(?:(\d+)'\s*)?(?:(\d+(?:\.\d+)?)\")?", re.ASCII)
_LONG_TIME = re.compile(
    r"(?:(\d+)\s*d(?:ay)?\s*)?(?:(\d+)\s*h\s*)?(?:(\d+)\s*min\s*)?(?:(\d+(?:\.\d+)?)\s*s)?", re.ASCII
)
_TOKEN = re.compile(r"\s*(?:(1(?!\d))|([^\s\d·*/^()+.,-]+)|([·*/()]))", re.ASCII)
_EXPONENT = re.compile(r"\^\(-?\d+(?:\.\d+)?\)|\^?-?\d+(?:\.\d+)?", re.ASCII)
_EXPONENT_LIMIT = 9


def normalise(text: str) -> str:
    """One spelling for the many that keyboards and word processors make: NFKC, ASCII minus, `^2` for ²."""
    text = _SUPERSCRIPT_RUN.sub(lambda run: "^" + run.group().translate(_SUPERSCRIPTS), text)
    text = unicodedata.normalize("NFKC", text)
    for seen, meant in (("−", "-"), ("′′", '"'), ("′", "'"), ("μ", "µ"), ("⋅", "·")):
        text = text.replace(seen, meant)
    return text.strip()


def parse(text: str) -> Quantity:
    """The quantity that `text` spells; QuantityError says what is wrong with it.

    Accepts a number with a unit product, days to seconds (`1 h 30 min`), and degrees with minutes and seconds of arc
    (`54°44'08"`). A bare number is a ratio.
    """
    clean = normalise(text)
    if match := _SEXAGESIMAL.fullmatch(clean):
        return _sexagesimal(*match.groups(default="0"))
    if (match := _LONG_TIME.fullmatch(clean)) and len([part for part in match.groups() if part]) > 1:
        days, hours, minutes, seconds = (float(part) for part in match.groups(default="0"))
        return Quantity(((days * 24 + hours) * 60 + minutes) * 60 + seconds, _TIME)
    match = _QUANTITY.fullmatch(clean)
    if match is None:
        raise QuantityError(f"'{text}' is not a number with a unit")
    unit = parse_unit(match[2] or "")
    return finite(float(match[1]) * unit.factor, unit.dimension)


def _sexagesimal(sign: str, degrees: str, minutes: str, seconds: str) -> Quantity:
    if float(minutes) >= 60 or float(seconds) >= 60:
        raise QuantityError("has 60 or more minutes or seconds of arc")
    total = float(degrees) + float(minutes) / 60 + float(seconds) / 3600
    return Quantity(-total if sign == "-" else total, _ANGLE)


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """The unit that `text` spells, "" for a ratio; a `/` divides by the one factor or parenthesis after it."""
    clean = normalise(text)
    if not clean:
        return _ONE
    unit, rest = _product(clean, text)
    if rest:
        raise QuantityError(f"'{text.strip()}' is not a unit")
    return unit


def _product(rest: str, text: str) -> tuple[Unit, str]:
    """Reads factors up to the end or a closing parenthesis; returns what is left after them."""
    unit, operator = _ONE, "·"
    while True:
        factor, rest = _factor(rest, text)
        unit = unit * (factor**-1 if operator == "/" else factor)
        match = _TOKEN.match(rest)
        if match is None or match[3] not in ("·", "*", "/"):
            return unit, rest
        operator, rest = match[3], rest[match.end() :]


def _factor(rest: str, text: str) -> tuple[Unit, str]:
    match = _TOKEN.match(rest)
    if match is None or not (match[1] or match[2] or match[3] == "("):
        raise QuantityError(f"'{text.strip()}' is not a unit")
    rest = rest[match.end() :]
    if match[3] == "(":
        unit, rest = _product(rest, text)
        if not rest.startswith(")"):
            raise QuantityError(f"'{text.strip()}' lacks a closing parenthesis")
        return unit, rest[1:]
    unit = _ONE if match[1] else _symbol(match[2], text)
    exponent = _EXPONENT.match(rest)
    if exponent is None:
        return unit, rest
    power = float(exponent[0].strip("^()"))
    if abs(power) > _EXPONENT_LIMIT:
        raise QuantityError(f"'{text.strip()}' has an exponent beyond {_EXPONENT_LIMIT}")
    return unit**power, rest[exponent.end() :]


def _symbol(symbol: str, text: str) -> Unit:
    known = _PLAIN.get(symbol) or _PREFIXABLE.get(symbol)
    if known is not None:
        return known
    if symbol in _REFUSED:
        raise QuantityError(_REFUSED[symbol])
    prefix, rest = symbol[:1], symbol[1:]
    if prefix in _PREFIXES and rest in _PREFIXABLE:
        return Unit(_PREFIXES[prefix], NO_DIMENSION) * _PREFIXABLE[rest]
    raise QuantityError(f"'{symbol}' in '{text.strip()}' is not a known unit")


# What people write a dimension in; the first that fits.
_CUSTOMARY = (
    "", "s", "°C", "°", "A", "V", "m", "g", "pulse", "°C/min", "°/s", "°/s²", "Hz", "m/s²", "pulse/s", "Ω", "W",
)  # fmt: skip


def spell(quantity: Quantity) -> str:
    """The quantity in its customary unit, like "20 °C" or "1 °C/min"; base units where there is none."""
    for unit in _CUSTOMARY:
        if parse_unit(unit).dimension == quantity.dimension:
            return f"{quantity.to(unit):.12g} {unit}".rstrip()
    return f"{quantity.base_value:.12g} {describe(quantity.dimension)}"


def describe(dimension: Dimension) -> str:
    """A dimension in words for a message: "°C/s", or "a bare number"."""
    if dimension == NO_DIMENSION:
        return "a bare number"
    for unit in _CUSTOMARY[1:]:
        if parse_unit(unit).dimension == dimension:
            return unit
    above = "·".join(_power(b, p) for b, p in zip(BASES, dimension, strict=True) if p > 0) or "1"
    return above + "".join("/" + _power(b, -p) for b, p in zip(BASES, dimension, strict=True) if p < 0)


def _power(base: str, power: float) -> str:
    return base if power == 1 else f"{base}^{power:g}"


def _plain(value: float) -> float:
    """Without the last bits that a conversion leaves: 0.1 + 0.2 stays what a person would write."""
    return float(f"{value:.15g}")

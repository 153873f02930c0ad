r"""Numbers with units: "30 min", "-40 °C", "54°44'08\"", "2 µg/Hz^0.5".

One full-match grammar and an algebra of dimensions; text that does not match completely is rejected. The text is kept:
`6 °C/h` and `0.1 °C/min` are the same quantity to the last bit, and `to` gives 6 and 0.1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from drivers.quantity.units import (
    NO_DIMENSION,
    Dimension,
    QuantityError,
    base_unit,
    customary_unit,
    describe,
    dimension_of,
    in_unit,
    normalise,
    parse_unit,
    quoted,
    taken_for_angle,
)

_ANGLE = parse_unit("°").dimension
_TIME = parse_unit("s").dimension


@dataclass(frozen=True, slots=True)
class Quantity:
    """A finite number in base units with its dimension; `+ - * /` and comparison check dimensions.

    `written` is the parsed text, with single spaces; empty for a computed value. It is not part of the value: equal
    quantities may be written differently.
    """

    base_value: float
    dimension: Dimension = NO_DIMENSION
    written: str = field(default="", compare=False, repr=False)

    def to(self, unit: str) -> float:
        """Number in `unit`, without rounding residue of the conversion.

        Raises QuantityError if the dimensions differ, or if the number overflows in `unit`.
        """
        target = parse_unit(unit)
        if target.dimension != self.dimension:
            found = f"in {describe(self.dimension)}" if self.dimension != NO_DIMENSION else "a bare number"
            angle = "°" in self.written and taken_for_angle(self.dimension, target.dimension)
            hint = f"; write {self.written.replace('°', '°C')}" if angle else ""
            raise QuantityError(f"is {found}, expected {in_unit(unit)}{hint}")
        try:
            return _plain(Fraction(self.base_value) / target.factor)
        except OverflowError:
            raise QuantityError("is not a finite number") from None

    def _same(self, other: object, verb: str) -> Quantity:
        value = as_quantity(other)
        if value.dimension != self.dimension:
            raise QuantityError(f"cannot {verb} {describe(self.dimension)} and {describe(value.dimension)}")
        return value

    def __add__(self, other: object) -> Quantity:
        return finite(self.base_value + self._same(other, "add").base_value, self.dimension)

    def __sub__(self, other: object) -> Quantity:
        return finite(self.base_value - self._same(other, "subtract").base_value, self.dimension)

    def __mul__(self, other: object) -> Quantity:
        value = as_quantity(other)
        powers = dimension_of(a + b for a, b in zip(self.dimension, value.dimension, strict=True))
        return finite(self.base_value * value.base_value, powers)

    def __truediv__(self, other: object) -> Quantity:
        value = as_quantity(other)
        if value.base_value == 0:
            raise QuantityError("division by zero")
        powers = dimension_of(a - b for a, b in zip(self.dimension, value.dimension, strict=True))
        return finite(self.base_value / value.base_value, powers)

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

    def __bool__(self) -> bool:
        raise QuantityError("a quantity is neither true nor false; compare it with another")

    def __str__(self) -> str:
        return spell(self)


def finite(base_value: float, dimension: Dimension) -> Quantity:
    """Return the quantity; QuantityError if the number is infinite or not a number."""
    if not math.isfinite(base_value):
        raise QuantityError("is not a finite number")
    return Quantity(base_value, dimension)


def as_quantity(value: object) -> Quantity:
    """Convert a bare number to a ratio; a quantity is returned unchanged, anything else is rejected."""
    if isinstance(value, Quantity):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return finite(float(value), NO_DIMENSION)
    raise QuantityError(f"{'a list' if isinstance(value, tuple) else quoted(value)} is not a quantity")


_QUANTITY = re.compile(
    r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)"  # a number,
    r"(?:\s*([^\d\s_,;].*)|\s+(1\s*/.*))?",  # and a unit, which begins with no digit unless it is 1/…
    re.ASCII,
)
_PARTED = re.compile(r"[+-]?\d+[_, ]\d", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,(?!\d{3}\b)\d+(?![\d,])", re.ASCII)
_LETTERS = re.compile(r"[+-]?(?:\d[\d.]*[OIl]|[OoIl](?=[\d.]))[\d.OoIl]*(?=\s|°|$)", re.ASCII)
_DASH = re.compile(r"[‐‒–—]\s*(?=\.?\d)")
_TWO_POINTS = re.compile(r"[+-]?(\d*\.\d+|\d+\.)\.?\d*\.[\d.]*\s*(\D*)", re.ASCII)
_CLOCK = re.compile(r"(\d+):(\d\d)(?::(\d\d))?", re.ASCII)
_UNIT_LEFT_OUT = re.compile(r"(\d+)\s*(d|day|h|min)\s*(\d+)", re.ASCII)
_NEXT_SMALLER = {"d": "h", "day": "h", "h": "min", "min": "s"}
_DIGITS_LIKE = str.maketrans("OoIl", "0011")
_NAME = re.compile(r"(?!\$\{|(?:nan|inf)\b)[$({]*([a-z]\w+)[)}]*", re.ASCII)
_SEXAGESIMAL = re.compile(r"([+-]?)(\d+)°\s*(?=\d)(?:(\d+)'\s*)?(?:(\d+(?:\.\d+)?)\")?", re.ASCII)
_ALMOST_SEXAGESIMAL = re.compile(r"[+-]?[\d.]+°\s*-?\d", re.ASCII)
_LONG_TIME = re.compile(
    r"(?:(\d+)\s*d(?:ay)?\s*)?(?:(\d+)\s*h\s*)?(?:(\d+)\s*min\s*)?(?:(\d+(?:\.\d+)?)\s*s)?", re.ASCII
)


def parse(text: str) -> Quantity:
    """Parse `text`; QuantityError with the problem.

    Accepts a number with a unit product, days to seconds (`1 h 30 min`), and degrees with minutes and seconds of arc
    (`54°44'08"`). A bare number is a ratio.
    """
    found = _parsed(text)
    return Quantity(found.base_value, found.dimension, " ".join(text.split()))


def _parsed(text: str) -> Quantity:
    clean = normalise(text)
    if match := _SEXAGESIMAL.fullmatch(clean):
        return _sexagesimal(*match.groups(default="0"))
    if (match := _LONG_TIME.fullmatch(clean)) and len([part for part in match.groups() if part]) > 1:
        days, hours, minutes, seconds = (Fraction(part) for part in match.groups(default="0"))
        return _rounded(((days * 24 + hours) * 60 + minutes) * 60 + seconds, _TIME)
    if _ALMOST_SEXAGESIMAL.match(clean):
        raise QuantityError(f"{quoted(text)} is not an angle; write minutes and seconds of arc like 54°44'08\"")
    is_slip = (
        _TWO_POINTS.fullmatch(clean)
        or _LETTERS.match(clean)
        or _CLOCK.fullmatch(clean)
        or _UNIT_LEFT_OUT.fullmatch(clean)
    )
    match = None if is_slip else _QUANTITY.fullmatch(clean)
    if match is None:
        raise QuantityError(f"{quoted(text)} is not a quantity{_hint(clean)}")
    unit = parse_unit(match[2] or match[3] or "")
    roughly = finite(float(match[1]), NO_DIMENSION).base_value
    exactly = Fraction(match[1]) if roughly else Fraction(0)  # 1e-999999999 has no fraction that fits in memory
    return _rounded(exactly * unit.factor, unit.dimension)


def _hint(text: str) -> str:
    """Suggestion for a text that is no quantity, as the tail of a message."""
    if (letters := _LETTERS.match(text)) is not None:
        digits = letters[0].translate(_DIGITS_LIKE)
        return f"; a letter is used for a digit: write {digits}{text[letters.end() :]}"
    if _DECIMAL_COMMA.match(text):
        return f"; use a decimal point: write {text.replace(',', '.', 1)}"
    if _PARTED.match(text):
        return "; write 1500 or 1.5, nothing between the digits"
    if _DASH.match(text):
        return f"; a dash is used as minus sign: write {_DASH.sub('-', text, count=1)}"
    if (points := _TWO_POINTS.fullmatch(text)) is not None:
        number = points[1].rstrip(".")
        return f"; a number has one decimal point: write it like {f'{number} {points[2]}'.strip()}"
    if (clock := _CLOCK.fullmatch(text)) is not None:
        return f"; write a duration with its units: {_duration(*clock.groups())}"
    if (parts := _UNIT_LEFT_OUT.fullmatch(text)) is not None:
        return f"; the last unit is missing: write {parts[1]} {parts[2]} {parts[3]} {_NEXT_SMALLER[parts[2]]}"
    name = _NAME.fullmatch(text)
    return f"; if it is a parameter, write ${{{name[1]}}}" if name else ""


def _duration(first: str, second: str, third: str | None) -> str:
    """Suggestion for a time in clock format; for two numbers it is open whether the first is hours or minutes."""
    if third is None:
        return f"{_with_units((first, second), ('h', 'min'))} or {_with_units((first, second), ('min', 's'))}"
    return _with_units((first, second, third), ("h", "min", "s"))


def _with_units(numbers: Sequence[str], units: Sequence[str]) -> str:
    parts = [f"{int(number)} {unit}" for number, unit in zip(numbers, units, strict=True) if int(number)]
    return " ".join(parts) or f"0 {units[-1]}"


def _sexagesimal(sign: str, degrees: str, minutes: str, seconds: str) -> Quantity:
    if float(minutes) >= 60 or float(seconds) >= 60:
        raise QuantityError("has 60 or more minutes or seconds of arc")
    total = Fraction(degrees) + Fraction(minutes) / 60 + Fraction(seconds) / 3600
    return _rounded(-total if sign == "-" else total, _ANGLE)


def _rounded(exactly: Fraction, dimension: Dimension) -> Quantity:
    """Round to the nearest float, once, at the end, so that equal quantities are equal however they are written."""
    try:
        return Quantity(float(exactly), dimension)
    except OverflowError:
        raise QuantityError("is not a finite number") from None


def spell(quantity: Quantity) -> str:
    """Format in the customary unit, like "20 °C" or "1 °C/min"; in base units if there is none.

    A number that overflows in the customary unit is also in base units.
    """
    unit = customary_unit(quantity.dimension)
    try:
        number = quantity.to(unit)
    except QuantityError:
        unit, number = base_unit(quantity.dimension), quantity.base_value
    return f"{number:.12g} {unit}".rstrip()


def _plain(value: Fraction) -> float:
    """Format a number without rounding residue of a conversion, and without the sign of a zero."""
    rounded = float(f"{float(value):.15g}") + 0.0
    return rounded if math.isfinite(rounded) else float(value)  # the largest numbers cannot be rounded up

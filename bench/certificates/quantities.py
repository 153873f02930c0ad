"""Quantities of a certificate with their uncertainties, in the forms of D-SI 2.0 to 2.2."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import NamedTuple, TypeVar

from bench.certificates import dsi
from bench.certificates.markup import Element, Markup, named, plain
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import QuantityError, parse_unit

ICE_POINT = Fraction("273.15")
_NUMBER = re.compile(r"[-+]?(\d{0,40}\.\d{1,40}|\d{1,40}\.?)([Ee][-+]?\d{1,3})?", re.ASCII)
_MOST = 10_000  # values of a list
_QUANTITIES = (
    "dcc:measurementResults/dcc:measurementResult/dcc:results//dcc:quantity"
    "[not(ancestor::dcc:measurementMetaData or ancestor::dcc:influenceConditions)]"
)
Item = TypeVar("Item")

# Elements of an uncertainty, and the coverage factor beside them: D-SI 2.0 and 2.1, then 2.2. A standard uncertainty
# has none. In D-SI 2.2 the element around them has three names: of a number, of one in a list, of all in a list.
_FORMS = (
    ("si:expandedUnc/si:uncertainty", "si:coverageFactor"),
    ("si:expandedMU/si:valueExpandedMU", "si:coverageFactor"),
    ("si:coverageInterval/si:standardUnc", ""),
    ("si:standardMU/si:valueStandardMU", ""),
    ("si:coverageIntervalMU/si:valueStandardMU", ""),
    ("si:coverageIntervalMU/si:standardUnc", ""),
)
_AROUND = (
    "si:measurementUncertaintyUnivariate",
    "si:measurementUncertaintyUnivaraite",
)  # the second is spelled so there
_OF_ALL = ("si:listUnivariateUnc", "si:listMeasurementUncertaintyUnivariate")
_LISTS = (
    ("si:expandedUncXMLList/si:uncertaintyXMLList", "si:coverageFactorXMLList"),
    ("si:expandedMUXMLList/si:valueExpandedMUXMLList", "si:coverageFactorXMLList"),
    ("si:coverageIntervalXMLList/si:standardUncXMLList", ""),
    ("si:standardMUXMLList/si:valueStandardMUXMLList", ""),
    ("si:coverageIntervalMUXMLList/si:valueStandardMUXMLList", ""),
)
_AROUND_LISTS = "si:measurementUncertaintyUnivariateXMLList"
_MISSING = "NaN"  # a number in D-SI 2.2
_NUMBERS = ".//si:*[not(*)][not(self::si:label or self::si:labelXMLList)]"


class Value(NamedTuple):
    """Number in the unit of a certificate, with its expanded uncertainty and coverage factor, None if not stated.

    `written` is the unit as in the certificate, `label` the label of the number, "" without one.
    """

    number: Fraction
    unit: dsi.Read
    written: str
    expanded: Fraction | None = None
    k: Fraction | None = None
    label: str = ""

    @property
    def quantity(self) -> Quantity:
        """The value in base units; a temperature in kelvin is one in degrees Celsius."""
        return self._in_base(self.number - (ICE_POINT if self.unit.is_kelvin else 0))

    @property
    def difference(self) -> Quantity:
        """The value in base units, as a difference."""
        return self._in_base(self.number)

    def uncertainty(self, k: Fraction) -> Quantity:
        """The expanded uncertainty in base units for another coverage factor. It must be stated."""
        assert self.expanded is not None  # noqa: S101  the caller has looked
        assert self.k is not None  # noqa: S101
        return self._in_base(self.expanded * k / self.k)

    def _in_base(self, number: Fraction) -> Quantity:
        return Quantity(float(number * self.unit.unit.factor), self.unit.unit.dimension)


class Stated(NamedTuple):
    """Quantity of a certificate: its names (id, refType, name), its values, its element, and the list it is part of."""

    names: frozenset[str]
    title: str
    values: tuple[Value, ...]
    at: Element
    inside: Element | None


def quantities(markup: Markup) -> list[Stated]:
    """Return the quantities of all results. Raises InputError for numbers and units that cannot be read."""
    found = []
    for element in markup.all(_QUANTITIES):
        title = named(next(iter(markup.all("dcc:name", element)), None))
        names = {element.get("id", ""), *element.get("refType", "").split(), title} - {""}
        parent = next(iter(markup.all("parent::dcc:list", element)), None)
        found.append(Stated(frozenset(names), title, tuple(_values(markup, element)), element, parent))
    return found


def _values(markup: Markup, quantity: Element) -> Iterator[Value]:
    """Yield the values of a quantity; none if one of its numbers is missing, for a row of a table would be, too."""
    if any(_MISSING in plain(each).split() for each in markup.all(_NUMBERS, quantity)):
        return
    for part in [*_readable(markup, quantity), quantity]:  # of a hybrid only one, its parts being equal
        for real in markup.all("self::si:real | self::dcc:quantity/si:real", part):
            yield _single(markup, real)
        for listed in markup.all("self::si:realListXMLList | self::dcc:quantity/si:realListXMLList", part):
            yield from _listed(markup, listed)
    for listed in markup.all("si:list/si:realList", quantity):
        yield from _in_list(markup, listed)


def _readable(markup: Markup, quantity: Element) -> list[Element]:
    """The first part of a hybrid, such as one in kelvin and in °C, whose unit is known; else its first part."""
    parts = markup.all("si:hybrid/si:real | si:hybrid/si:realListXMLList", quantity)
    for part in parts:
        try:
            dsi.read(markup.text("si:unit | si:unitXMLList", part).partition(" ")[0])
        except QuantityError:
            continue
        return [part]
    return parts[:1]


def _single(markup: Markup, real: Element, unit: str = "") -> Value:
    unit = markup.text("si:unit", real) or unit
    expanded, k = _uncertainty(markup, real)
    number, label = _number(markup, "si:value", real), markup.text("si:label", real)
    return Value(number, _unit(markup, unit, real), unit, expanded, k, label)


def _uncertainty(markup: Markup, real: Element) -> tuple[Fraction | None, Fraction | None]:
    for part in (real, *markup.all(" | ".join(_AROUND), real)):
        for value, factor in _FORMS:
            for stated in markup.all(value, part):
                k = _number(markup, f"../{factor}", stated) if factor else Fraction(1)
                return _sound(markup, _read(markup, plain(stated), real), k, real)
    return None, None


def _sound(markup: Markup, expanded: Fraction, k: Fraction, at: Element) -> tuple[Fraction, Fraction]:
    if expanded < 0 or k <= 0:
        raise markup.problem("has an uncertainty below 0, or a coverage factor that is not above 0", at)
    return expanded, k


def _in_list(markup: Markup, listed: Element) -> Iterator[Value]:
    """Values of a list with one unit and one uncertainty for all."""
    unit = markup.text("si:listUnit", listed)
    common = markup.all(" | ".join(_OF_ALL), listed)
    expanded, k = _uncertainty(markup, common[0]) if common else (None, None)
    for real in markup.all("si:real", listed):
        value = _single(markup, real, unit)
        yield value if value.expanded is not None else value._replace(expanded=expanded, k=k)


def _listed(markup: Markup, listed: Element) -> Iterator[Value]:
    numbers = _numbers(markup, "si:valueXMLList", listed)
    units = _as_many(markup, markup.text("si:unitXMLList", listed).split(), numbers, listed, "units")
    expanded: Sequence[Fraction | None] = [None] * len(numbers)
    ks: Sequence[Fraction | None] = expanded
    for part in (listed, *markup.all(_AROUND_LISTS, listed)):
        for value, factor in _LISTS:
            for stated in markup.all(value, part):
                found = _numbers(markup, ".", stated)
                expanded = _as_many(markup, found, numbers, listed, "uncertainties")
                found = _numbers(markup, f"../{factor}", stated) if factor else [Fraction(1)]
                ks = _as_many(markup, found, numbers, listed, "coverage factors")
    for number, unit, u, k in zip(numbers, units, expanded, ks, strict=True):
        if u is not None and k is not None:
            _sound(markup, u, k, listed)
        yield Value(number, _unit(markup, unit, listed), unit, u, k)


def _as_many(
    markup: Markup, items: Sequence[Item], numbers: Sequence[Fraction], at: Element, what: str
) -> Sequence[Item]:
    """One item for each number; a single item is for all."""
    if len(items) == 1:
        return list(items) * len(numbers)
    if len(items) != len(numbers):
        raise markup.problem(f"has {len(numbers)} values and {len(items)} {what}", at)
    return items


def _numbers(markup: Markup, where: str, inside: Element) -> list[Fraction]:
    words = markup.text(where, inside).split()
    if not words or len(words) > _MOST:
        raise markup.problem(f"has a list of {len(words)} numbers, 1 to {_MOST} are read", inside)
    return [_read(markup, word, inside) for word in words]


def _number(markup: Markup, where: str, inside: Element) -> Fraction:
    return _read(markup, markup.text(where, inside), inside)


def _read(markup: Markup, text: str, at: Element) -> Fraction:
    if _NUMBER.fullmatch(text) is None:
        raise markup.problem(f"'{text[:60]}' is not a decimal number", at)
    return Fraction(text)


def _unit(markup: Markup, text: str, at: Element) -> dsi.Read:
    try:
        return dsi.read(text)
    except QuantityError as problem:
        raise markup.problem(str(problem), at) from None


def in_unit(value: Value, unit: str) -> bool:
    """Return whether a value has the dimension of a unit of this project."""
    return value.unit.unit.dimension == parse_unit(unit).dimension

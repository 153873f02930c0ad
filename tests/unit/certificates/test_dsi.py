"""Units of D-SI: every unit that a report may show, read by an independent table; and those of certificates."""

import itertools
import math

import pytest

from bench.certificates import dsi
from bench.sequence.method import OUTPUT_UNITS, known_methods
from drivers.description import known_drivers
from drivers.quantity.units import BASES, QuantityError, parse_unit
from tests.support.dcc import in_si

G = 9.79541
RADIAN = math.pi / 180
# Of the bases of this project: factor to base units of the SI; g is local gravity, counts are of dimension one.
BASE = {
    "s": (1, (1, 0, 0, 0, 0, 0)), "m": (1, (0, 1, 0, 0, 0, 0)), "kg": (1, (0, 0, 1, 0, 0, 0)),
    "A": (1, (0, 0, 0, 1, 0, 0)), "°C": (1, (0, 0, 0, 0, 1, 0)), "°": (RADIAN, (0, 0, 0, 0, 0, 1)),
    "g": (G, (-2, 1, 0, 0, 0, 0)), "pulse": (1, (0,) * 6), "code": (1, (0,) * 6),
}  # fmt: skip


def shown_units():
    for method in known_methods().values():
        for output, gyro in itertools.product(OUTPUT_UNITS, OUTPUT_UNITS):
            yield from method.units(output, gyro).values()
        yield from method.displayed.values()


def channel_units():
    for driver in known_drivers().values():
        if not callable(driver.channels):
            yield from driver.channels.values()


def expected(unit):
    """Factor and powers of a unit by the bases of this project."""
    known = parse_unit(unit)
    factor, powers = float(known.factor), [0.0] * 6
    for base, power in zip(BASES, known.dimension, strict=True):
        factor *= BASE[base][0] ** power
        powers = [each + power * more for each, more in zip(powers, BASE[base][1], strict=True)]
    return factor, tuple(powers)


UNITS = sorted(
    {*shown_units(), *channel_units(), "µg/Hz^0.5", "rpm", "turn", "ppm/h", "hPa", "°/h^0.5", "mg", "µrad/g"}
)


@pytest.mark.parametrize("unit", UNITS)
def test_every_unit_has_one_of_the_same_size_in_d_si(unit):
    written = dsi.written(unit)
    in_unit, powers = in_si(written.text)
    factor, wanted = expected(unit)
    assert powers == pytest.approx(wanted)
    assert in_unit * float(written.factor) * G**written.gravity == pytest.approx(factor, rel=1e-12)


def test_units_of_all_methods_and_drivers_are_tried():
    assert len(UNITS) > 50
    assert {"pulse/s/g", "g/°C²", "pulse/s/(m/s²)", "V", "rad", "1"} <= set(UNITS)


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("m/s²", r"\metre\second\tothe{-2}"), ("mV", r"\milli\volt"), ("pulse", r"\one"), ("", r"\one"),
        ("°C", r"\degreecelsius"), ("ppm/°C", r"\ppm\kelvin\tothe{-1}"), ("m/s²/(m/s²)", r"\one"),
        ("µg", r"\metre\second\tothe{-2}"), ("hPa", r"\hecto\pascal"), ("arcsec", r"\arcsecond"),
    ],
)  # fmt: skip
def test_the_usual_spelling(unit, text):
    assert dsi.written(unit).text == text


def test_relative_to_local_gravity_no_metre_is_left():
    assert dsi.written("µg", g_is_one=True) == (r"\one", pytest.approx(1e-6), 0.0)
    assert dsi.written("mA/g", g_is_one=True).text == r"\milli\ampere"


@pytest.mark.parametrize("unit", [unit for unit in UNITS if "g" not in unit])
def test_what_is_written_is_read_as_the_same_unit(unit):
    written, own = dsi.written(unit), parse_unit(unit)
    read = dsi.read(written.text).unit
    assert float(read.factor * written.factor) == pytest.approx(float(own.factor), rel=1e-12)
    counts = [BASES.index(each) for each in ("pulse", "code")]
    assert read.dimension == tuple(0.0 if at in counts else power for at, power in enumerate(own.dimension))


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        (r"\micro\volt\per\volt", "ppm"), (r"\kelvin", "°C"), (r"\joule\per\kilogram", "m·m/s^2"),
        (r"\milli\metre\tothe{2}", "m²"), (r"\kilo\gram", None), (r"\hour\tothe{-1}", "1/h"),
        (r"\milli\volt|\volt", "mV"), ("V", None), ("", None), (r"\milli", None), (r"\per", None),
        (r"\volt\tothe{2}x", None), (r"\furlong", None), (r"\metre\tothe{99}", None), ("\\metre" * 100, None),
    ],
)  # fmt: skip
def test_units_of_certificates(text, unit):
    if unit is None:
        with pytest.raises(QuantityError):
            dsi.read(text)
        return
    own, read = parse_unit(unit), dsi.read(text).unit
    assert read.dimension == own.dimension
    assert float(read.factor) == pytest.approx(float(own.factor) * (1e-6 if unit == "m²" else 1))

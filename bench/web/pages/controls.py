"""Controls of manual control: a form for each order that an instrument can take, with the limits beside its inputs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from bench.figures.languages import tr
from bench.station.instruments.view import InstrumentView, LimitView
from bench.web.pages.readings import label
from bench.web.shown import name_in_words, number

NUMBER = re.compile(r"[+-]?\d+([.,]\d+)?")
UNIT = "unit."  # prefix of the hidden field with the unit of an input
TURN_S = "30"


class Input(NamedTuple):
    """Input of a form: key of the order, unit, permitted range in words, value at first, choices of a list."""

    key: str
    title: str
    unit: str = ""
    limit: str = ""
    value: str = ""
    choices: tuple[tuple[str, str], ...] = ()


class Form(NamedTuple):
    """Form of an order; `does` says what its button does, `fixed` are the fields that nobody types."""

    button: str
    does: str
    fixed: tuple[tuple[str, str], ...]
    inputs: tuple[Input, ...] = ()


class Control(NamedTuple):
    """Controls of one instrument; what an order has started can be halted where `moves`."""

    role: str
    title: str
    safe_state: str
    moves: bool
    forms: tuple[Form, ...]


def controls(instruments: list[InstrumentView]) -> list[Control]:
    """Return the controls of the instruments of a bench in the current language."""
    found = [Control(each.role, each.title, each.safe_state, _moves(each), tuple(_forms(each))) for each in instruments]
    return [each for each in found if each.forms]


def order_of(fields: Mapping[str, str]) -> dict[str, str]:
    """Return the order of a form: its verb first, without empty fields, a number alone in the unit of its input."""
    order: dict[str, str] = {}
    for key, given in fields.items():
        value, unit = given.strip(), fields.get(UNIT + key, "")
        if key.startswith(UNIT) or not value:
            continue
        order[key] = f"{value.replace(',', '.')} {unit}" if unit and NUMBER.fullmatch(value) else value
    return order


def _moves(each: InstrumentView) -> bool:
    return bool({"positioner", "rate_table", "thermal_chamber"} & set(each.capabilities))


def _forms(each: InstrumentView) -> Iterator[Form]:
    role, able = each.role, each.capabilities
    if "positioner" in able:
        yield from _motion(each)
    if "rate_table" in able:
        yield Form(
            tr("Turn"), tr("Turns {role} at this rate for this time, then brings it to rest.", role=tr(role)),
            (("rotate", role),),
            (
                Input("at", tr("turning rate"), "°/s", _limit(each, "rate", both=True)),
                Input("for", tr("time"), "s", value=TURN_S),
            ),
        )  # fmt: skip
    if "thermal_chamber" in able:
        yield Form(
            tr("Change temperature"),
            tr("Moves the set point of {role} to this temperature; the air follows.", role=tr(role)),
            (("ramp", role),),
            (
                Input("to", tr("temperature"), "°C", _limit(each, "temperature")),
                Input("at", tr("ramp rate"), "°C/min", _limit(each, "ramp_rate"), "1"),
            ),
        )  # fmt: skip
    if {"power_supply", "current_source"} & set(able):
        yield from _output(each)
    if channels := tuple((name, label(name)) for name in each.channels):
        yield Form(
            tr("Read"), tr("Reads one new value and writes it to the record."), (),
            (Input("measure", tr("reading"), choices=channels),),
        )  # fmt: skip


def _motion(each: InstrumentView) -> Iterator[Form]:
    role = each.role
    yield Form(
        tr("Move"), tr("Turns {role} to this angle and waits until it has settled.", role=tr(role)),
        (("move", role),), (Input("to", tr("angle"), "°", _limit(each, "angle")),),
    )  # fmt: skip
    yield Form(tr("Home"), tr("Turns {role} to 0°.", role=tr(role)), (("move", role), ("to", "0 °")))


def _output(each: InstrumentView) -> Iterator[Form]:
    role = each.role
    inputs = (
        (
            Input("voltage", tr("voltage"), "V", _limit(each, "voltage")),
            Input("current_limit", tr("current limit"), "A", _limit(each, "current")),
        )
        if "power_supply" in each.capabilities
        else (
            Input("current", tr("current"), "A", _limit(each, "current")),
            Input("compliance", tr("compliance"), "V", _limit(each, "compliance")),
        )
    )  # fmt: skip
    yield Form(
        tr("Switch on"), tr("Sets these values, then switches the output of {role} on.", role=tr(role)),
        (("set", role), ("output", "on")), inputs,
    )  # fmt: skip
    yield Form(
        tr("Switch off"), tr("Switches the output of {role} off.", role=tr(role)), (("set", role), ("output", "off"))
    )


def _limit(each: InstrumentView, name: str, *, both: bool = False) -> str:
    """Return the permitted range in words; `both` for a limit of the size in either direction."""
    limit = next((limit for limit in each.limits if limit.name == name), None)
    return tr("no limit in the bench file") if limit is None else limit_in_words(limit, both=both)


def limit_name(limit: LimitView) -> str:
    """Return the name of a permitted range in words."""
    return name_in_words(limit.name)


def limit_in_words(limit: LimitView, *, both: bool = False) -> str:
    """Return a permitted range in words."""
    if both and limit.low is None and limit.high is not None:
        return f"± {number(limit.high, limit.unit)}"
    if limit.low is None:
        return tr("at most {high}", high=number(limit.high, limit.unit))
    if limit.high is None:
        return tr("at least {low}", low=number(limit.low, limit.unit))
    return tr("{low} to {high}", low=number(limit.low), high=number(limit.high, limit.unit))

"""Elements of a certificate: texts in the languages of a certificate, quantities in D-SI."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from typing import NamedTuple

from lxml import etree

from bench.certificates.markup import NAMES, Element
from bench.figures.languages import ENGLISH, current, language
from bench.metrology.results.coverage import PROBABILITY
from bench.metrology.results.finding import CONFIDENCE
from bench.report.dcc import versions

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # characters that XML cannot have
Words = Callable[[], str]
"""A text in the current language."""


class Number(NamedTuple):
    """Value in a unit of D-SI with its standard uncertainty, 0 if that is unknown, and coverage factor.

    `dof` are its degrees of freedom, None for unlimited. `interval` is its range if it is not a linear function of the
    readings, with a coverage of 95 %.
    """

    value: float
    unit: str
    u: float = 0.0
    k: float = 2.0
    dof: int | None = None
    interval: tuple[float, float] | None = None

    @property
    def is_finite(self) -> bool:
        """True if it can be written."""
        return all(map(math.isfinite, (self.value, self.u, self.k, *(self.interval or ()))))


def element(name: str, text: str = "", **attributes: str) -> Element:
    """Return an element, such as dcc:name, with the namespaces of certificates."""
    prefix, _, local = name.partition(":")
    made = etree.Element(f"{{{NAMES[prefix]}}}{local}", {key: each for key, each in attributes.items() if each}, NAMES)
    made.text = _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text.strip()) or None  # from 3.2 on texts have no edges
    return made


def add(parent: Element, name: str, text: str = "", **attributes: str) -> Element:
    """Add an element to another, and return it."""
    made = element(name, text, **attributes)
    parent.append(made)
    return made


def say(parent: Element, name: str, words: Words | str, **attributes: str) -> Element:
    """Add a text: in the current language and in English, or one that is in no language."""
    made = add(parent, name, **attributes)
    if isinstance(words, str):
        add(made, "dcc:content", words)
        return made
    for lang in languages():
        with language(lang):
            add(made, "dcc:content", words(), lang=lang)
    return made


def languages() -> list[str]:
    """Languages of the texts: the current one first, and English."""
    return list(dict.fromkeys((current(), ENGLISH)))


def quantity(parent: Element, name: Words | str, number: Number | None, **attributes: str) -> Element:
    """Add a quantity; without a number its value is added by the caller."""
    made = add(parent, "dcc:quantity", **attributes)
    say(made, "dcc:name", name)
    if number is not None:
        made.append(real(number))
    return made


def real(number: Number, label: str = "") -> Element:
    """Return a value of D-SI with its expanded uncertainty, or with its coverage interval."""
    made = element("si:real")
    if label:
        add(made, "si:label", label)
    add(made, "si:value", decimal(number.value))
    add(made, "si:unit", number.unit)
    if number.u <= 0:
        return made
    names = versions.current().uncertainties
    around = add(made, names.around) if names.around else made
    if number.interval is not None:
        stated = add(around, names.interval)
        add(stated, names.standard_value, decimal(number.u))
        for side, value in zip(("Min", "Max"), number.interval, strict=True):
            add(stated, f"si:interval{side}", decimal(value))
        add(stated, "si:coverageProbability", f"{CONFIDENCE}")
        return made
    stated = add(around, names.expanded)
    add(stated, names.expanded_value, decimal(number.k * number.u))
    add(stated, "si:coverageFactor", f"{number.k!r}")
    add(stated, "si:coverageProbability", f"{PROBABILITY}")
    add(stated, "si:distribution", "normal" if number.dof is None else f"t, {number.dof} degrees of freedom")
    return made


def decimal(value: float) -> str:
    """Format a finite number with all its digits, a point, and a power of ten where it is short."""
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be written in a certificate")
    return repr(float(value) + 0.0)


def identify(parent: Element, entries: Iterable[tuple[str, str, Words]], ref_type: str = "") -> None:
    """Add identifications, each with its issuer, value and name; none without a value."""
    if not (stated := [entry for entry in entries if entry[1].strip()]):
        return
    made = add(parent, "dcc:identifications")
    for issuer, value, name in stated:
        each = add(made, "dcc:identification", refType=ref_type)
        add(each, "dcc:issuer", issuer)
        add(each, "dcc:value", value)
        say(each, "dcc:name", name)


def contact(
    parent: Element, tag: str, name: Words | str, address: str = "", email: str = "", *, is_strict: bool = True
) -> Element:
    """Add a person or an organisation; a strict one has a location, "-" if it is not stated.

    In 3.1 it has an e-mail address too, empty if it is not stated.
    """
    made = add(parent, tag)
    say(made, "dcc:name", name)
    if is_strict:
        if email or not versions.current().is_extended:
            add(made, "dcc:eMail", email)
        say(add(made, "dcc:location"), "dcc:further", address or "-")
    return made

"""A certificate as a whole: who calibrated what and when, and until when it is valid."""

from __future__ import annotations

import calendar
import datetime as dt
import re
from pathlib import Path
from typing import NamedTuple

from bench.certificates.markup import Markup, named, plain, read_markup
from bench.certificates.quantities import Stated, quantities

DUE = "itb_due"  # refType of the statement with the date of the next calibration
_CORE, _STATEMENTS = "dcc:administrativeData/dcc:coreData", "dcc:administrativeData/dcc:statements/dcc:statement"
_ITEMS = "dcc:administrativeData/dcc:items"
_VALUE = "dcc:identifications/dcc:identification/dcc:value"
_PERIOD = re.compile(r"P(?:(\d{1,3})Y)?(?:(\d{1,4})M)?(?:(\d{1,5})D)?(?:T.*)?", re.ASCII)


class Certificate(NamedTuple):
    """Content of a certificate; `serials` identify its items, `due` is None if it states no next calibration."""

    markup: Markup
    number: str
    laboratory: str
    date: dt.date
    due: dt.date | None
    serials: tuple[str, ...]
    items: tuple[str, ...]
    quantities: tuple[Stated, ...]


def read_certificate(path: Path) -> Certificate:
    """Read a certificate. Raises InputError with file and line for what it lacks, or what cannot be read."""
    markup = read_markup(path)
    number, date = _needed(markup, f"{_CORE}/dcc:uniqueIdentifier"), _needed(markup, f"{_CORE}/dcc:endPerformanceDate")
    laboratory = markup.all("dcc:administrativeData/dcc:calibrationLaboratory/dcc:contact/dcc:name")
    lists = markup.all(f"{_ITEMS} | {_ITEMS}//dcc:subItems")  # from 3.3 on items have items
    items = [item for each in lists for item in markup.all("dcc:item", each)]
    serials = [serial for each in (*lists, *items) for serial in markup.all(_VALUE, each)]
    return Certificate(
        markup,
        number,
        named(laboratory[0]) if laboratory else "",
        _date(markup, date),
        _due(markup),
        tuple(plain(each) for each in serials),
        tuple(named(next(iter(markup.all("dcc:name", item)), None)) for item in items),
        tuple(quantities(markup)),
    )


def not_valid(certificate: Certificate) -> str:
    """Return the declaration of a certificate that it is not valid; "" for a valid one."""
    markup = certificate.markup
    for statement in markup.all(_STATEMENTS):
        stated = markup.text("dcc:valid", statement) or markup.text("dcc:validXMLList", statement)
        if {"false", "0"} & set(stated.split()):
            return markup.text("dcc:declaration", statement) or "a statement without words"
    return ""


def _needed(markup: Markup, where: str) -> str:
    if text := markup.text(where):
        return text
    raise markup.problem(f"has no {where.rpartition(':')[2]}")


def _due(markup: Markup) -> dt.date | None:
    """Date of the next calibration by a statement: its own, or a date and the period from then."""
    for statement in markup.all(_STATEMENTS):
        date, period = markup.text("dcc:date", statement), markup.text("dcc:period", statement)
        if date and DUE in statement.get("refType", "").split():
            return _date(markup, date)
        if date and (found := _PERIOD.fullmatch(period)) is not None:
            years, months, days = (int(part or 0) for part in found.groups())
            return _later(_date(markup, date), 12 * years + months) + dt.timedelta(days)
    return None


def _later(date: dt.date, months: int) -> dt.date:
    year, month = divmod(date.year * 12 + date.month - 1 + months, 12)
    return date.replace(year=year, month=month + 1, day=min(date.day, calendar.monthrange(year, month + 1)[1]))


def _date(markup: Markup, text: str) -> dt.date:
    try:
        return dt.date.fromisoformat(text[:10])
    except ValueError:
        raise markup.problem(f"'{text[:40]}' is not a date") from None

"""The certificate of an instrument as the block `calibration` of a bench file.

A quantity `itb_NAME` is a correction to be added to readings, and its expanded uncertainty is `U.NAME`. A table has
readings and errors of them; its greatest expanded uncertainty is `U.offset` (docs/decisions/0129).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel

from bench.certificates.certificate import Certificate, not_valid
from bench.certificates.quantities import Stated, Value, in_unit
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import in_unit as in_words
from drivers.schema.fields import InUnit
from drivers.schema.suggest import did_you_mean

OWN = "itb_"
RANGE = f"{OWN}range"
ERRORS = frozenset({"basic_measurementError", "basic_measurementError_error"})  # reading minus true value
CORRECTIONS = frozenset({f"{OWN}correction", "basic_measurementError_correction"})
READINGS = ("basic_measuredValue", "basic_nominalValue")
COMMON = Fraction(2)  # coverage factor of all uncertainties where the certificate has several
OFFSET = "offset"


class Block(NamedTuple):
    """Values of a certificate for a bench file: uncertainties with their k, corrections, and the readings covered."""

    k: float
    uncertainties: dict[str, Any]
    corrections: dict[str, Any]
    covers: tuple[Quantity, Quantity] | None


class Wanted(NamedTuple):
    """What a bench file takes from a certificate: units by key, those of uncertainties that are lists, and a table.

    `chosen` names the quantity of a key where it is not `itb_KEY`. `stated` are keys of U that the bench file states
    itself, for the coverage factor 2.
    """

    uncertainties: Mapping[str, str]
    lists: frozenset[str]
    corrections: Mapping[str, str]
    table: str  # key of the corrections that are a table; "" if there is none
    rows: tuple[str, str]  # units of its columns at and add
    chosen: Mapping[str, str]
    stated: frozenset[str]


def wanted(
    uncertainty: type[BaseModel], corrections: type[BaseModel], chosen: Mapping[str, str], stated: frozenset[str]
) -> Wanted:
    """Return what the models of `U` and `corrections` take from a certificate."""
    units = {name: _units(field.annotation, field.metadata) for name, field in uncertainty.model_fields.items()}
    lists = {name for name, field in uncertainty.model_fields.items() if _row(field.annotation, tuple) is not None}
    added = dict[str, str]()
    table, rows = "", ("", "")
    for name, field in corrections.model_fields.items():
        if (row := _row(field.annotation, BaseModel)) is not None:
            table, rows = name, (_unit_of(row, "at"), _unit_of(row, "add"))
        else:
            added[name] = next(_units(field.annotation, field.metadata))
    return Wanted(
        {name: next(found) for name, found in units.items()}, frozenset(lists), added, table, rows, chosen, stated
    )


def _unit_of(model: type[BaseModel], name: str) -> str:
    field = model.model_fields[name]
    return next(_units(field.annotation, field.metadata))


def _units(annotation: Any, metadata: Sequence[Any]) -> Iterator[str]:
    """Yield the units of a field, those of the members of a list or an alternative too."""
    yield from (each.unit for each in metadata if isinstance(each, InUnit))
    for part in (*get_args(annotation), *getattr(annotation, "__metadata__", ())):
        if isinstance(part, InUnit):
            yield part.unit
        else:
            yield from _units(part, ())


def _row(annotation: Any, kind: type) -> Any:
    """Return the member of a tuple of models, or the tuple itself; None for another annotation."""
    if getattr(annotation, "__origin__", None) is not tuple:
        return None
    member = get_args(annotation)[0]
    if kind is tuple:
        return member
    return member if isinstance(member, type) and issubclass(member, kind) else None


def block_of(certificate: Certificate, want: Wanted, serial: str) -> Block:
    """Return the values of a certificate. Raises InputError with file and line for each that does not fit."""
    markup = certificate.markup
    if words := not_valid(certificate):
        raise markup.problem(f"states that it is not valid: {words}")
    if serial not in certificate.serials:
        known = ", ".join(certificate.serials) or "none"
        raise markup.problem(f"is of serial number {known}, the bench file has {serial}")
    scalars, table = _scalars(certificate, want), _table(certificate, want)
    used = [value for stated in scalars.values() for value in stated.values]
    used += [error for _, error in table[1]] if table is not None else []
    if not used and want.uncertainties:  # others have no values that enter a result
        names = ", ".join(f"{OWN}{name}" for name in want.uncertainties)
        raise markup.problem(
            f"has none of the quantities {names}, and no table of errors; name those it has under 'quantities' "
            "('bench certificate' lists them)"
        )
    ks = {value.k for value in used if value.k is not None}
    k = next(iter(ks)) if len(ks) == 1 and not want.stated else COMMON
    uncertainties, corrections = dict[str, Any](), dict[str, Any]()
    for name, stated in scalars.items():
        found = [value.uncertainty(k) for value in stated.values]
        uncertainties[name] = found if name in want.lists else found[0]
        corrections |= _correction(certificate, want, name, stated)
    if table is not None:
        corrections[want.table] = _rows(table)
        uncertainties |= _of_table(certificate, want, table, k, {*uncertainties, *want.stated})
    return Block(float(k), uncertainties, corrections, _covers(certificate, table))


def _of_table(
    certificate: Certificate, want: Wanted, table: Table, k: Fraction, known: set[str]
) -> dict[str, Quantity]:
    """Uncertainty that a table states for the key offset; raises InputError if there is no such key, nor another."""
    stated, rows = table
    if OFFSET in want.uncertainties:
        if OFFSET in want.stated:
            raise certificate.markup.problem(
                f"states {OFFSET}, and so does U of the bench file; remove it there", stated.at
            )
        greatest = max((error.uncertainty(k) for _, error in rows), key=lambda each: each.base_value)
        return {} if OFFSET in known else {OFFSET: greatest}
    if not known:
        raise certificate.markup.problem(
            f"has a table of errors, and no quantity {', '.join(f'{OWN}{name}' for name in want.uncertainties)}, of "
            "which one at least is needed; state it in the bench file, under U", stated.at,
        )  # fmt: skip
    return {}


Table = tuple[Stated, list[tuple[Value, Value]]]
"""The quantity of errors or corrections of a table, and its rows: reading, and error or correction."""


def _scalars(certificate: Certificate, want: Wanted) -> dict[str, Stated]:
    own = {name for each in certificate.quantities for name in each.names if name.startswith(OWN)}
    known = {f"{OWN}{name}" for name in want.uncertainties} | {RANGE, *CORRECTIONS}
    for name in sorted(own - known):
        at = next(each.at for each in certificate.quantities if name in each.names)
        raise certificate.markup.problem(f"this instrument has no quantity '{name}'{did_you_mean(name, known)}", at)
    keys = {*want.uncertainties, want.table} - {""}
    for name in sorted(set(want.chosen) - keys):
        raise certificate.markup.problem(f"quantities: this instrument has no key '{name}'{did_you_mean(name, keys)}")
    found = {}
    for name, unit in want.uncertainties.items():
        stated = _one(certificate, want.chosen.get(name, f"{OWN}{name}"), needed=name in want.chosen)
        if stated is not None:
            if name in want.stated:
                raise certificate.markup.problem(
                    f"states {name}, and so does U of the bench file; remove it there", stated.at
                )
            _expect(certificate, stated, unit)
            if name not in want.lists and len(stated.values) != 1:
                raise certificate.markup.problem(
                    f"'{stated.title}' has {len(stated.values)} values, 1 is needed", stated.at
                )
            found[name] = stated
    return found


def _one(certificate: Certificate, name: str, *, needed: bool) -> Stated | None:
    found = [each for each in certificate.quantities if name in each.names]
    if len(found) > 1:
        raise certificate.markup.problem(
            f"has {len(found)} quantities '{name}'; choose one by its id under 'quantities'", found[1].at
        )
    if not found and needed:
        known = [each for stated in certificate.quantities for each in stated.names]
        raise certificate.markup.problem(f"has no quantity '{name}'{did_you_mean(name, known)}")
    return found[0] if found else None


def _expect(certificate: Certificate, stated: Stated, unit: str) -> None:
    """Raise InputError unless all values have this dimension and an uncertainty."""
    if not stated.values:
        raise certificate.markup.problem(f"'{stated.title}' has no number", stated.at)
    for value in stated.values:
        if not in_unit(value, unit):
            raise certificate.markup.problem(
                f"'{stated.title}' is in {value.written}, expected {in_words(unit)}", stated.at
            )
        if value.expanded is None:
            raise certificate.markup.problem(f"'{stated.title}' has no uncertainty", stated.at)


def _correction(certificate: Certificate, want: Wanted, name: str, stated: Stated) -> dict[str, Any]:
    """Correction by a quantity; 0 needs no place for it."""
    values = [value.difference for value in stated.values]
    if not any(value.base_value for value in values):
        return {}
    if name not in want.corrections:
        raise certificate.markup.problem(
            f"'{stated.title}' is {values[0]}, and there is no correction for it in the bench file; expected 0",
            stated.at,
        )
    return {name: -values[0] if ERRORS & stated.names else values[0]}


def _table(certificate: Certificate, want: Wanted) -> Table | None:
    """Table of errors or corrections: the chosen one, else the only one in the unit of the corrections."""
    if not want.table:
        return None
    wanted_name = want.chosen.get(want.table)
    candidates = [
        (stated, readings)
        for stated in certificate.quantities
        if stated.inside is not None
        and (wanted_name in stated.names if wanted_name else stated.names & (ERRORS | CORRECTIONS))
        for readings in certificate.quantities
        if readings.inside is stated.inside and readings.names & set(READINGS)
    ]
    if wanted_name and not candidates:
        raise certificate.markup.problem(f"has no table with a quantity '{wanted_name}' beside {' or '.join(READINGS)}")
    if not candidates:
        return None
    if len(candidates) > 1:
        raise certificate.markup.problem(
            f"has {len(candidates)} tables of errors; choose one by the id of its quantity of errors: quantities: "
            f"{{{want.table}: ID}}", candidates[1][0].at,
        )  # fmt: skip
    errors, readings = candidates[0]
    _expect(certificate, errors, want.rows[1])
    if len(errors.values) != len(readings.values):
        raise certificate.markup.problem(
            f"has {len(readings.values)} readings and {len(errors.values)} errors", errors.at
        )
    for reading in readings.values:
        if not in_unit(reading, want.rows[0]):
            raise certificate.markup.problem(
                f"'{readings.title}' is in {reading.written}, expected {in_words(want.rows[0])}", readings.at
            )
    return errors, sorted(zip(readings.values, errors.values, strict=True), key=lambda row: row[0].quantity.base_value)


def _rows(table: Table) -> list[dict[str, Quantity]]:
    stated, rows = table
    sign = -1 if ERRORS & stated.names else 1
    return [{"at": at.quantity, "add": error.difference * sign} for at, error in rows]


def _covers(certificate: Certificate, table: Table | None) -> tuple[Quantity, Quantity] | None:
    """Least and greatest reading that the certificate covers, by itb_range or by its table; None if not stated."""
    if (stated := _one(certificate, RANGE, needed=False)) is not None:
        found = sorted((value.quantity for value in stated.values), key=lambda each: each.base_value)
        if len(found) != 2 or found[0].dimension != found[1].dimension:
            raise certificate.markup.problem(f"'{RANGE}' has {len(found)} values, 2 of one unit are needed", stated.at)
        return found[0], found[1]
    if table is None:
        return None
    return table[1][0][0].quantity, table[1][-1][0].quantity

"""Places of a bench that have a unit in a run."""

from __future__ import annotations

from collections.abc import Collection

from bench.config.models import BenchFile
from bench.config.places import UNIT_KINDS
from bench.errors import InputError
from bench.sequence.document.model import Outline
from bench.sequence.method import known_methods


def occupied(bench: BenchFile, sequence: Outline, named: Collection[str] = ()) -> BenchFile:
    """The bench for a run of a sequence, with units in the named places only.

    If none is named, every place has one whose kind of unit the methods of the sequence measure, those for the first of
    UNIT_KINDS where they measure both; all places, if it has no method or no place suits its methods. InputError if a
    named place does not suit them and another does.
    """
    measured = [known_methods()[entry.method].kinds for entry in sequence.results if entry.method in known_methods()]
    suited = [name for name, place in bench.places.items() if all(place.kind in kinds for kinds in measured)]
    by_kind = ([name for name in suited if bench.places[name].kind == kind] for kind in UNIT_KINDS)
    usual = next(filter(None, by_kind), suited) if measured else suited
    if suited and (others := [name for name in named if name not in suited]):
        raise InputError(
            f"place '{others[0]}' is for {UNIT_KINDS[bench.places[others[0]].kind]}, the sequence measures "
            f"{UNIT_KINDS[bench.places[suited[0]].kind]}; name one with --uut {suited[0]}=SERIAL"
        )
    return bench.with_units_in(named or usual or bench.places)

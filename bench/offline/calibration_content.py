"""Content of the calibration files that a run writes: its results on a unit, for programs that use the unit."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench.config.models import BenchFile
from bench.files import content_hash

if TYPE_CHECKING:  # a run starts without loading what only its results need
    from bench.metrology.results.finding import UnitResult

SCHEMA, DIGEST = "itb-calibration/1", "digest"


def calibration_files(
    units: Sequence[UnitResult], manifest: Mapping[str, Any], bench: BenchFile
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and content of a file for each unit with compensations.

    1 g in it is the local gravity of the bench, which it states.
    """
    gravity = bench.site.gravity
    for place in dict.fromkeys(unit.place for unit in units):
        found = [unit for unit in units if unit.place == place]
        channels = [each.to_json() for unit in found for each in unit.compensations]
        if channels:
            content = {
                "schema": SCHEMA,
                "uut": found[0].uut,
                "run": manifest["run"],
                "sequence": manifest["sequence"],
                "started": manifest["started"],
                "simulated": bool(manifest["simulated"]),
                "verdict": next((u.verdict for u in found if u.verdict != "PASS"), "PASS"),
                "gravity_mps2": gravity.value,
                "u_gravity_mps2": gravity.U / gravity.k,
                "channels": channels,
            }
            yield f"calibration_{place}.json", {**content, DIGEST: digest_of(content)}


def digest_of(content: Mapping[str, Any]) -> str:
    """Digest of all other content of a file, independent of indentation and order."""
    text = json.dumps({key: value for key, value in content.items() if key != DIGEST}, sort_keys=True)
    return content_hash(text.encode())

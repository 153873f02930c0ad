"""A simulated bench with any number of units: three on each counter."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import yaml

CONFIG = Path(__file__).parents[1] / "config"
OF_A_COUNTER = "abc"
CHANNELS = "xyz"


def written(folder: Path, units: int) -> tuple[Path, list[str]]:
    """The file of a bench in a folder, and the places of so many units."""
    shutil.copytree(CONFIG, folder / "config")
    bench = yaml.safe_load((CONFIG / "three_units.yaml").read_text("utf-8"))
    devices, readings, places = bench["devices"], bench["readings"], bench["places"]
    first = {kind: dict(bench[kind]) for kind in ("devices", "readings", "places")}
    for number in range(1, -(-units // len(OF_A_COUNTER))):
        counter = f"counter_{number}"
        devices[counter] = _counter(first["devices"]["counter"], number)
        for letter in OF_A_COUNTER:
            place = f"{letter}{number}"
            devices[f"supply_{place}"] = _supply(first["devices"][f"supply_{letter}"], number)
            old = first["readings"][f"temperature_{letter}"]
            readings[f"temperature_{place}"] = old | {"from": old["from"].replace("counter.", f"{counter}.")}
            own = {"channel": f"{CHANNELS[OF_A_COUNTER.index(letter)]}{number}", "supply": f"supply_{place}"}
            bench["simulation"]["units"][place] = bench["simulation"]["units"][letter]
            places[place] = first["places"][letter] | own | {"temperature": f"temperature_{place}"}
    path = folder / "config" / "wide.yaml"
    path.write_text(json.dumps(bench, default=str, ensure_ascii=False), "utf-8")  # without the aliases of yaml
    return path, list(places)[:units]


def _counter(first: dict[str, object], number: int) -> dict[str, object]:
    options = dict(first["options"])
    options["channels"] = {f"{name}{number}": signals for name, signals in options["channels"].items()}
    connection = first["connection"].replace("/can?", f"/can{number}?")
    return first | {"options": options, "connection": connection, "identity": {"serial": f"SIM-IFC-{number:03}"}}


def _supply(first: dict[str, object], number: int) -> dict[str, object]:
    address, _, port = first["connection"].rpartition(":")
    serial = f"{first['identity']['serial']}-{number}"
    return first | {
        "connection": f"{address}:{int(port) + 10 * number}",
        "identity": first["identity"] | {"serial": serial},
    }

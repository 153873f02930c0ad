"""Reference pages on bench files: common keys, and keys of each installed driver."""

from __future__ import annotations

import inspect

from bench.app.laboratory import simulator_of
from bench.app.reference.keys import Blocks, keys, part, table
from bench.config.models import BenchFile
from drivers.description import DriverDescription, known_drivers
from drivers.transport.address import SCHEMES
from simulators.faults.instrument_faults import fault_effects_of


def bench_page() -> Blocks:
    """Keys of a bench file except those of drivers."""
    return [
        "# Bench files",
        "A file in `config/`, like [the shipped one](../../config/simulated.yaml): the instruments of a bench, their "
        "limits and certificates, and the places of the units. `bench devices --bench FILE` checks it and "
        "identifies every instrument. The `options`, `limits` and `safe` of a device and the `U` and `corrections` "
        "of its "
        "calibration are defined by its driver: [drivers](drivers.md).",
        "NAME is chosen by you. A key with an empty default is optional. How quantities and names are "
        "written: [values](sequence.md#values).",
        *keys(BenchFile, 2),
    ]


def drivers_page() -> Blocks:
    """Capabilities, connections and keys of each installed driver."""
    drivers = known_drivers()
    return [
        "# Drivers",
        "Instruments available in a [bench file](bench.md), including installed plug-ins.",
        table(
            ("`driver`", "instrument"),
            ((f"[`{name}`](#{name})", drivers[name].title) for name in sorted(drivers)),
        ),
        "## Connections",
        "`sim+` before an address selects the simulator. `tcp` is for an instrument with a "
        "network interface. `serial`, and `socket` (a serial line behind a server), do not protect answers: if "
        "the protocol has no checksum, readings that enter a result are taken twice.",
        table(("scheme", "written like", "options after `?`"), map(_connection, SCHEMES)),
        "The faults of a simulator can be injected by a [scenario](../how-to/rehearse_a_bad_night.md).",
        *(block for name in sorted(drivers) for block in _driver(drivers[name])),
    ]


def _connection(name: str) -> tuple[str, str, str]:
    scheme = SCHEMES[name]
    options = (f"`{key}`" + (f": {', '.join(values)}" if values else "") for key, values in scheme.options.items())
    return f"`{name}`", f"`{scheme.example}`", "; ".join(options)


def _driver(driver: DriverDescription) -> Blocks:
    facts = [
        ("is a", ", ".join(f"`{name}`" for name in sorted(driver.capabilities))),
        ("is reached by", ", ".join(f"`{scheme}`" for scheme in sorted(driver.schemes))),
        ("readings", _readings(driver)),
        ("faults of its simulator", _faults(driver)),
    ]
    blocks = [
        *part(driver.options, "options", 3),
        *part(driver.limits, "limits", 3),
        *part(driver.safe, "safe", 3),
        *part(driver.uncertainty, "calibration.U", 3),
        *part(driver.corrections, "calibration.corrections", 3),
    ]
    return [f"## {driver.name}", f"{driver.title[:1].upper()}{driver.title[1:]}.", table(("", ""), facts), *blocks]


def _faults(driver: DriverDescription) -> str:
    simulator = simulator_of(driver)
    if simulator is None:
        return "it has no simulator"
    return "those of its wire, " + ", ".join(f"`{kind}`" for kind in fault_effects_of(simulator))


def _readings(driver: DriverDescription) -> str:
    if callable(driver.channels):
        return inspect.getdoc(driver.channels) or ""
    return ", ".join(f"`{name}` ({unit})" if unit else f"`{name}`" for name, unit in driver.channels.items())

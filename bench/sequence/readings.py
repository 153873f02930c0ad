"""What a step that looks at a reading looks at: a named reading of the bench, a channel of a device, a pulse rate."""

from __future__ import annotations

from collections.abc import Mapping

from bench.config.models import BenchFile
from bench.sequence.expressions import Value
from drivers.capabilities import MEASURES_OUTPUTS, OUTPUT, READING, THERMOMETER
from drivers.quantities import Quantity
from drivers.suggest import did_you_mean
from drivers.units import parse_unit

PULSE_RATE = "pulse/s"


def problem_with(name: str, needs: Mapping[str, str], bench: BenchFile | None) -> str:
    """Why a reading cannot be looked at; empty when it can. What the bench lacks of the needs is told with them."""
    device, dot, channel = name.partition(".")
    if needs.get(device) == OUTPUT:
        return f"'{device}' is the output of all units; name a reading, or a channel of a device that is needed"
    if not dot:
        kind = needs.get(name)
        if kind is None:
            return f"'{name}' is not among the needs of the sequence{did_you_mean(name, needs)}"
        if kind not in (THERMOMETER, READING):
            return f"'{name}' is a {kind}; name a reading of it such as {name}.{_a_channel(name, bench)}"
        return ""
    if device not in needs or needs[device] in (THERMOMETER, READING):
        return f"'{device}' is not among the devices that the sequence needs{did_you_mean(device, needs)}"
    if bench is None or device not in bench.devices or unit_of(name, bench) is not None:
        return ""
    return f"'{device}' has no channel '{channel}'{did_you_mean(channel, _known(device, bench))}"


def problem_with_output(name: str, needs: Mapping[str, str], bench: BenchFile | None) -> str:
    """Why outputs cannot be looked at: of all units, of those of one device or channel of it; empty when they can."""
    device, dot, channel = name.partition(".")
    kind = needs.get(device)
    if kind is None:
        return f"'{device}' is not among the devices that the sequence needs{did_you_mean(device, needs)}"
    if kind not in MEASURES_OUTPUTS:
        return f"'steady' needs a {' or '.join(MEASURES_OUTPUTS)}, '{device}' is a {kind}"
    if bench is None or (device not in bench.devices and kind != OUTPUT):
        return ""
    if dot and channel not in (known := _outputs(device, bench)):
        return f"'{device}' has no output on a channel '{channel}'{did_you_mean(channel, known)}"
    return "" if units_at(name, bench) else f"no unit puts out anything that '{name}' measures"


def units_at(name: str, bench: BenchFile) -> tuple[str, ...]:
    """The places of the units whose output a role measures, or one channel of it."""
    device, _, channel = name.partition(".")
    roles = set(bench.acquired_from(device))
    return tuple(
        place
        for place, entry in bench.places.items()
        if roles.intersection(bench.measuring(entry)) and (not channel or channel in entry.measured_by.values())
    )


def unit_of(name: str, bench: BenchFile) -> str | None:
    """The unit of a reading; None when the bench has no such reading."""
    name = bench.members(name)[0]
    source = bench.readings[name].from_ if name in bench.readings else name
    device, _, channel = source.partition(".")
    if device not in bench.devices:
        return None
    if channel in _counted(device, bench):
        return PULSE_RATE
    return bench.devices[device].channels.get(channel)


def is_pulse_rate(name: str, bench: BenchFile) -> bool:
    """Whether a reading is the pulse rate of a counter's channel, which is counted rather than polled."""
    device, _, channel = name.partition(".")
    return device in bench.devices and channel in _counted(device, bench)


def example_of(name: str, bench: BenchFile | None) -> Value | None:
    """A value of a reading's kind, for checking expressions; None when its unit is not known."""
    unit = unit_of(name, bench) if bench is not None else None
    if unit is None:
        return None
    return Quantity(float(parse_unit(unit).factor), parse_unit(unit).dimension)


def _known(device: str, bench: BenchFile) -> list[str]:
    return [*bench.devices[device].channels, *_counted(device, bench)]


def _counted(device: str, bench: BenchFile) -> tuple[str, ...]:
    entry = bench.devices[device]
    if "pulse_counter" not in entry.description.capabilities:
        return ()
    return tuple(getattr(entry.options, "channels", {}))


def _outputs(device: str, bench: BenchFile) -> tuple[str, ...]:
    """The channels on which a device measures outputs, or units send them; none of a voltmeter."""
    return tuple(getattr(bench.devices[device].options, "channels", {})) if device in bench.devices else ()


def _a_channel(device: str, bench: BenchFile | None) -> str:
    known = _known(device, bench) if bench and device in bench.devices else []
    return known[0] if known else "CHANNEL"

"""Readings that steps can use: a named reading of the bench, a channel of a device, a pulse rate.

Another one is the output of the unit in a place, in g by its nominal scale factor, whatever measures it; of an inertial
unit that of one accelerometer.
"""

from __future__ import annotations

from collections.abc import Mapping

from bench.config.models import BenchFile
from bench.sequence.language.expressions import Value
from drivers.can.sent_frames import Counted
from drivers.capabilities import MEASURES_OUTPUTS, OUTPUT, READING, THERMOMETER
from drivers.quantity.quantities import Quantity
from drivers.quantity.units import parse_unit
from drivers.schema.suggest import did_you_mean

PULSE_RATE = Counted.unit
BY_NOMINAL = "g"  # unit of an output, independent of the instrument that measures it


def problem_with(name: str, needs: Mapping[str, str], bench: BenchFile | None) -> str:
    """Reason why a reading cannot be used; empty if it can. Needs that the bench lacks are reported elsewhere."""
    device, dot, channel = name.partition(".")
    if needs.get(device) == OUTPUT:
        return _problem_with_unit(name, bench)
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


def _problem_with_unit(name: str, bench: BenchFile | None) -> str:
    """Reason why the output of a single unit cannot be measured; empty if it can."""
    role, dot, rest = name.partition(".")
    place, _, sensor = rest.partition(".")
    if not dot:
        known = next(iter(bench.places), "PLACE") if bench is not None else "PLACE"
        return f"'{role}' is the output of all units; name one by its place: {role}.{known}"
    if bench is None:
        return ""
    if place not in bench.places:
        return f"the bench has no unit in place '{place}'{did_you_mean(place, bench.places)}"
    sensors = bench.places[place].accelerometers
    if sensors and sensor not in sensors:
        return (
            f"the inertial unit in place '{place}' has several outputs; name one of its accelerometers, such as "
            f"{role}.{place}.acc_x, or a channel of its counter"
        )
    if sensor and not sensors:
        return f"the unit in place '{place}' has one output; name it {role}.{place}"
    if bench.nominal_per_g(place) is None:
        parts = " and ".join(bench.places[place].output_per_g_keys)
        return f"places.{place} of the bench file has no nominal {parts}, which its output in g needs"
    return ""


def measured_place(name: str, bench: BenchFile) -> str | None:
    """Place of the unit whose output ROLE.PLACE or ROLE.PLACE.SENSOR means; None for any other reading."""
    role, _, rest = name.partition(".")
    place = rest.partition(".")[0]
    return place if role not in bench.devices and place in bench.places else None


def problem_with_output(name: str, needs: Mapping[str, str], bench: BenchFile | None) -> str:
    """Reason why outputs of all units, or those of one device or channel, cannot be monitored; empty if they can."""
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
    return "" if units_at(name, bench) else f"no unit has an output that '{name}' measures"


def units_at(name: str, bench: BenchFile) -> tuple[str, ...]:
    """Places of the units whose output a role, or one channel of it, measures."""
    device, _, channel = name.partition(".")
    roles = set(bench.acquired_from(device))
    return tuple(
        place
        for place, entry in bench.places.items()
        if roles.intersection(bench.measuring(entry)) and (not channel or channel in entry.measured_by.values())
    )


def unit_of(name: str, bench: BenchFile) -> str | None:
    """Unit of a reading; None if the bench has no such reading."""
    if measured_place(name, bench) is not None:
        return BY_NOMINAL
    name = bench.members(name)[0]
    source = bench.readings[name].from_ if name in bench.readings else name
    device, _, channel = source.partition(".")
    if device not in bench.devices:
        return None
    if channel in _counted(device, bench):
        return PULSE_RATE
    return bench.devices[device].channels.get(channel)


def is_pulse_rate(name: str, bench: BenchFile) -> bool:
    """True if a reading is the pulse rate of a counter channel, which is counted rather than polled."""
    device, _, channel = name.partition(".")
    return device in bench.devices and channel in _counted(device, bench)


def example_of(name: str, bench: BenchFile | None) -> Value | None:
    """Example of a value of a reading, for checking expressions; None if its unit is unknown."""
    unit = unit_of(name, bench) if bench is not None else None
    if unit is None:
        return None
    return Quantity(float(parse_unit(unit).factor), parse_unit(unit).dimension)


def _known(device: str, bench: BenchFile) -> list[str]:
    return [*bench.devices[device].channels, *_counted(device, bench)]


def _counted(device: str, bench: BenchFile) -> tuple[str, ...]:
    return tuple(name for name, output in bench.devices[device].outputs.items() if isinstance(output, Counted))


def _outputs(device: str, bench: BenchFile) -> tuple[str, ...]:
    """Channels on which a device measures or receives outputs of units; none for a voltmeter."""
    return tuple(bench.devices[device].outputs) if device in bench.devices else ()


def _a_channel(device: str, bench: BenchFile | None) -> str:
    known = _known(device, bench) if bench and device in bench.devices else []
    return known[0] if known else "CHANNEL"

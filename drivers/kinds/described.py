"""What the descriptions of all chambers, indexing heads, rate tables and current sources have in common."""

from __future__ import annotations

from functools import partial

from drivers.certificates.corrections import AxisCorrections, CurrentCorrections
from drivers.certificates.current_standard import CurrentUncertainty
from drivers.description import DriverDescription
from drivers.kinds.axes import AxisUncertainty
from drivers.kinds.chamber import description as chamber
from drivers.kinds.head import description as head
from drivers.kinds.ranges import SourceLimits
from drivers.kinds.table import description as table
from drivers.safe_state import ZERO_THEN_OFF

thermal_chamber = partial(
    DriverDescription,
    capabilities=frozenset({"thermal_chamber"}),
    limits=chamber.ChamberLimits,
    safe=chamber.ChamberSafe,
    safe_state=chamber.safe_state,
    channels=chamber.CHANNELS,
)
indexing_head = partial(
    DriverDescription,
    capabilities=frozenset({"positioner"}),
    limits=head.HeadLimits,
    safe_state=head.safe_state,
    busy_s=head.busy_s,
    uncertainty=AxisUncertainty,
    corrections=AxisCorrections,
    channels={"angle": "°"},
)
rate_table = partial(
    DriverDescription,
    capabilities=frozenset({"positioner", "rate_table"}),
    limits=table.TableLimits,
    safe_state=table.safe_state,
    busy_s=table.busy_s,
    uncertainty=AxisUncertainty,
    corrections=AxisCorrections,
    channels={"angle": "°", "rate": "°/s"},
)
current_source = partial(
    DriverDescription,
    capabilities=frozenset({"current_source"}),
    limits=SourceLimits,
    safe_state=ZERO_THEN_OFF,
    uncertainty=CurrentUncertainty,
    corrections=CurrentCorrections,
    channels={"current": "A"},
)

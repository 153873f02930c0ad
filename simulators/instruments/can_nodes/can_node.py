"""Common part of simulated CAN nodes: computed lazily, when frames are taken."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.can.bus_errors import BUS_OFF
from drivers.can.dbc import Dbc, Field, encode_frames
from drivers.can.frame_block import ERROR, FrameBlock
from drivers.can.options import IDLE_BLOCK_S
from drivers.can.sorted_block import joined, merged
from drivers.errors import LinkLost
from drivers.installed import loaded
from simulators.faults.frame_faults import FrameFault, apply_fault
from simulators.faults.instrument_faults import PASSIVE_FAULT, FaultEffect, FaultKind, FaultPlan
from simulators.units.accelerometer_unit import SimulatedUnit
from simulators.units.gyro_unit import SimulatedGyro
from simulators.units.imu import ImuChannel
from simulators.units.unit_file import stream
from simulators.world import World

Array = NDArray[np.float64]
TEMPERATURE_PERIOD_S = 1.0
BAD_SHARE = 0.02  # share of affected frames on a bad bus
PROTOCOL_ERROR = 0x008
Source = SimulatedUnit | SimulatedGyro | ImuChannel
"""Source of the counts or samples of one channel: a unit, or a channel of an inertial unit."""


@dataclass(frozen=True, slots=True)
class NodeSetup:
    """A device of a bench file that sends frames, as given to its simulator.

    `options` is the driver's own model. `places` are the places of the units whose outputs it sends, by channel. By
    reading name: `readings` gives the place of the unit with the thermometer, `boards` the place of the converter with
    it, `imu_readings` the place and the sensors of an inertial unit. `encoder_skew_s` is the delay of the encoder latch
    after the end of a sample; that of counters is a setting of the world.
    """

    role: str
    world: World
    faults: FaultPlan
    options: Any
    places: Mapping[str, str] = field(default_factory=dict)
    readings: Mapping[str, str] = field(default_factory=dict)
    boards: Mapping[str, str] = field(default_factory=dict)
    imu_readings: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    encoder_skew_s: float = 0.0

    @property
    def units(self) -> Mapping[str, Source]:
        """Simulated units, or sensors of inertial units, on its channels."""
        imus, counted = self.world.imus, self.world.counted
        return {
            channel: imus[place].channels[channel] if place in imus else counted[place]
            for channel, place in self.places.items()
        }


def make_node(target: str, setup: NodeSetup) -> CanNode:
    """Create the simulator at `module:Class`; imports its module. Raises NotSimulated."""
    of: Callable[[NodeSetup], CanNode] = loaded(target).of
    return of(setup)


class CanNode(ABC):
    """A node on the bus; as a frame link it delivers the frames that it has sent.

    A block of frames is computed when it is taken, or just before a stimulus changes.
    """

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        "frozen": PASSIVE_FAULT, "restart": PASSIVE_FAULT, "lost_frames": PASSIVE_FAULT, "lost_bursts": PASSIVE_FAULT,
        "doubled_frames": PASSIVE_FAULT, "late_frames": PASSIVE_FAULT, "foreign_frames": PASSIVE_FAULT,
        "short_frames": PASSIVE_FAULT, "swapped_frames": PASSIVE_FAULT, "error_frames": PASSIVE_FAULT,
        "bus_off": PASSIVE_FAULT,
    }  # fmt: skip

    def __init__(self, name: str, world: World, faults: FaultPlan) -> None:
        self.faults = faults
        self._name, self._world = name, world
        self._sent: list[FrameBlock] = []
        self._draws = stream(world.settings.seed, "bus", name)
        self._told_off = False
        self.may_swap: frozenset[int] = frozenset()  # identifiers of frames with equal content
        self.longest_block_s = IDLE_BLOCK_S

    @property
    def block_s(self) -> float:
        """Time for which frames may stay here; a rehearsal may lose buffered frames in a power cut."""
        return self.longest_block_s

    def take(self) -> FrameBlock:
        """Frames sent since the last call; LinkLost if the connection is cut."""
        self._world.look()
        self._catch_up()
        sent, self._sent = self._sent, []
        if self.faults.active("cut"):
            raise LinkLost(self._name, "the connection was cut", remedy="Check the cable, then run again.")
        return self._with_bus_faults(self._with_foreign(joined(sent)))

    def _with_bus_faults(self, frames: FrameBlock) -> FrameBlock:
        """Apply the faults of a bad bus to frames."""
        if self.faults.active("bus_off"):
            off_s = float(self._world.host_time(np.array(self.faults.since_s("bus_off"))))
            told, self._told_off = self._told_off, True
            return FrameBlock.joined([_before(frames, off_s), *([] if told else [_error_frame(BUS_OFF, off_s)])])
        for fault in FrameFault:
            if self.faults.active(fault.value):
                frames = apply_fault(fault, frames, self._draws, BAD_SHARE, self.may_swap).block
        if len(frames) and self.faults.active("error_frames"):
            frames = FrameBlock.joined([frames, _error_frame(PROTOCOL_ERROR, float(frames.at_s[-1]))])
        return frames

    def close(self) -> None:  # noqa: B027  nothing is to be done
        """Do nothing: a node is independent of its client."""

    def _with_foreign(self, frames: FrameBlock) -> FrameBlock:
        """Frames without those sent while the node was silent."""
        for span_s in self.faults.spans_s("silent"):
            begin_s, end_s = self._world.host_time(np.array(span_s))
            frames = frames.at(np.flatnonzero((frames.at_s < begin_s) | (frames.at_s >= end_s)))
        return frames

    @abstractmethod
    def _catch_up(self) -> None:
        """Send due frames."""


def in_order(blocks: Sequence[FrameBlock]) -> FrameBlock:
    """Merge blocks, each in order of time, by time; frames at equal times keep the order of the blocks."""
    return reduce(merged, blocks)


def _before(frames: FrameBlock, at_s: float) -> FrameBlock:
    """Frames sent before a time of the host's clock."""
    return frames.at(np.flatnonzero(frames.at_s < at_s))


def _error_frame(classes: int, at_s: float) -> FrameBlock:
    return FrameBlock.of([(at_s, ERROR | classes, bytes(8))])


def temperature_frames(
    dbc: Dbc, fields: Mapping[str, Field], celsius: Callable[[str], Array], host_s: Array
) -> FrameBlock:
    """One frame of each message with temperatures at each time; `celsius` gives them by `Message.Signal`."""
    values: dict[str, dict[str, NDArray[np.int64]]] = {}
    for name, (message, signal) in fields.items():
        raw = np.rint((celsius(name) - signal.offset) / signal.scale).astype(np.int64)
        values.setdefault(message.name, {})[signal.name] = raw
    return encode_frames(dbc, host_s, values)

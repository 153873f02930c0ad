"""Driver of the pulse counter whose frames a DBC describes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Field, Message
from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import Integers
from drivers.description import Nothing, Setup
from drivers.dialects.can_counter import wire
from drivers.dialects.can_counter.decoder import format_of
from drivers.dialects.can_counter.options import CounterOptions
from drivers.kinds.frame_source.counter import FreeCounter, Newest
from drivers.kinds.frame_source.intake import bound_format


class CanCounter(FreeCounter[CounterOptions]):
    """Pulse counter whose latches and counts are placed by a DBC."""

    def __init__(self, setup: Setup[CounterOptions, Nothing, Nothing]) -> None:
        super().__init__(setup, setup.options.period, setup.options.channels)
        self._format: wire.CounterFormat

    async def __aenter__(self) -> Self:
        """Open the channel and wait for a first latch; raises CannotConnect, NoAnswer, BadAnswer."""
        bind = partial(format_of, self._options)
        self._format, self._fingerprint = bound_format(self.name, self._options.dbc, bind)
        return await super().__aenter__()

    @property
    def _latch(self) -> Message:
        return self._format.sequence.message

    @property
    def _temperatures(self) -> Mapping[str, Field]:
        return self._format.temperatures

    def _latches(self, block: FrameBlock) -> tuple[Integers, NDArray[np.float64]]:
        return wire.latches(self._format, block)

    def _newest(self, block: FrameBlock) -> Newest:
        return wire.newest_counts(self._format, block)

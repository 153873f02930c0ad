"""Bus conditions reported by error frames, in the classes of Linux (include/uapi/linux/can/error.h)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame_block import ERROR, FrameBlock

BUS_OFF, RESTARTED = 0x040, 0x100
_CLASSES = {
    0x001: "transmission timeout",
    0x002: "lost arbitration",
    0x004: "controller problem",
    0x008: "protocol violation",
    0x010: "transceiver problem",
    0x020: "no acknowledgement",
    BUS_OFF: "bus off",
    0x080: "bus error",
    RESTARTED: "controller restarted",
}


def error_classes(block: FrameBlock) -> NDArray[np.uint32]:
    """The classes of the error frames in a block, one or more bits each."""
    return np.asarray(block.error_ids() & np.uint32(ERROR - 1), np.uint32)


def class_names(classes: Iterable[int]) -> str:
    """Names of error-frame classes for a message."""
    combined = 0
    for each in classes:
        combined |= each
    return ", ".join(text for bit, text in _CLASSES.items() if combined & bit) or "of unknown class"

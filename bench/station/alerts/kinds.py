"""Kinds of alerts, and the cause of one."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple


class Kind(StrEnum):
    """Kind of an alert."""

    QUESTION = "question"
    ALARM = "alarm"
    SAFE_STOP = "safe_stop"
    END = "end"
    DEVICE_LOST = "device_lost"
    DISK_LOW = "disk_low"
    ITEM_REFUSED = "item_refused"
    BENCH_STOPPED = "bench_stopped"
    CALIBRATION_DUE = "calibration_due"
    DIGEST = "digest"


# Kinds that somebody must act on: these go to the next route while nobody acknowledges them.
URGENT = frozenset({
    Kind.QUESTION, Kind.ALARM, Kind.SAFE_STOP, Kind.DEVICE_LOST, Kind.DISK_LOW, Kind.BENCH_STOPPED,
})  # fmt: skip
ENDS = frozenset({Kind.END, Kind.SAFE_STOP})


class Cause(NamedTuple):
    """Cause of an alert: `key` identifies it across restarts, `subject` is the run, bench or folder that it is about.

    `text` names the sentences in `words`, and `values` are for their places. `step` is that of a question.
    `by_program` is true for an end that the alert program of the bench file has reported as well. A `historical` cause
    arose while the station was down.
    """

    kind: Kind
    key: str
    subject: str
    text: str
    values: Mapping[str, str]
    bench: str = ""
    link: str = ""
    step: str = ""
    by_program: bool = False
    historical: bool = False

"""What has been added to a run since somebody looked last."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from bench.errors import StoreError
from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.quality import Valid
from bench.store.tail import Bucket, Tail, instant_at
from bench.store.writer import RunWriter
from drivers.can.frame_block import FrameBlock

BEGAN = "2026-11-21T08:15:03+00:00"


def frames(*at_s: float) -> FrameBlock:
    count = len(at_s)
    return FrameBlock(
        np.full(count, 0x10, np.uint32), np.array(at_s), np.full(count, 8, np.uint8), np.zeros((count, 8), np.uint8)
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    """A run of two channels, three steps and three blocks."""
    folder = tmp_path_factory.mktemp("tail")

    async def main() -> None:
        writer = RunWriter(folder)
        writer.event("run_begins", "", utc=BEGAN)
        writer.event("step_begins", "steps/a", label="tumble")
        writer.readings("air", "°C", [Valid(float(second), 20.0 + second, 1) for second in range(10)])
        writer.readings("supply", "V", [Valid(3.5, 15.0, 1)])
        for begin_s in (1.0, 3.0, 5.0):
            writer.frames("counter", f"steps/{begin_s:g}", frames(begin_s, begin_s + 1))
        writer.event("step_ended", "steps/a", label="tumble")
        writer.event("note", "steps/a", label="tumble")
        writer.event("step_failed", "steps/b", label="other")
        await writer.commit()
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    return folder


@pytest.fixture
def tail(written):
    with Tail(written) as found:
        yield found


@pytest.fixture
def empty(tmp_path):
    async def main() -> None:
        writer = RunWriter(tmp_path)
        await writer.commit()
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    with Tail(tmp_path) as found:
        yield found


def test_events_go_on_after_a_number(tail):
    every = tail.events()
    assert [each.kind for each in every] == ["run_begins", "step_begins", "step_ended", "note", "step_failed"]
    assert (every[1].seq, every[1].step, every[1].data) == (2, "steps/a", {"label": "tumble"})
    assert tail.events(2, 2) == every[2:4]
    assert tail.events(5) == []
    assert tail.last_event() == 5


def test_the_last_events_of_some_kinds_come_newest_first(tail):
    found = tail.of_kinds(["step_begins", "step_ended", "note"], 2)
    assert [(each.seq, each.kind, each.data) for each in found] == [
        (4, "note", {"label": "tumble"}), (3, "step_ended", {"label": "tumble"}),
    ]  # fmt: skip


def test_steps_are_found_by_a_text_in_their_data(tail):
    assert [(each.seq, each.kind, each.step) for each in tail.steps_with(['"tumble"'])] == [
        (2, "step_begins", "steps/a"), (3, "step_ended", "steps/a"),
    ]  # fmt: skip
    ((kind, data),) = ((each.kind, each.data) for each in tail.steps_with(["other", "nothing of it"]))
    assert (kind, data) == ("step_failed", {"label": "other"})


def test_the_begin_of_a_run_is_that_of_its_first_entry(tail, empty):
    began = tail.begins()
    assert began is not None
    assert began == (datetime.fromisoformat(BEGAN), tail.events()[0].at_s)
    assert empty.begins() is None


def test_the_last_reading_and_the_units_of_all(tail):
    assert tail.last_reading() == 11
    assert tail.channels() == {"air": "°C", "supply": "V"}


def test_the_span_is_that_of_the_first_and_the_last_reading(tail):
    assert tail.span_s() == (0.0, 3.5)


def test_an_envelope_has_the_extremes_of_each_interval(tail):
    assert tail.envelope("air", 5.0, 4.0) == [Bucket(4.0, 24.0, 27.0, 25.5), Bucket(8.0, 28.0, 29.0, 28.5)]
    assert tail.envelope("supply", 0.0, 2.0) == [Bucket(2.0, 15.0, 15.0, 15.0)]
    assert tail.envelope("nothing", 0.0, 2.0) == []


def test_the_newest_blocks_come_in_order(tail):
    found = tail.blocks(3.9, 10)
    assert [(each.seq, each.stream, each.step, each.frames) for each in found] == [
        (2, "counter", "steps/3", 2), (3, "counter", "steps/5", 2),
    ]  # fmt: skip
    assert [(round(each.first_s, 6), round(each.last_s, 6)) for each in found] == [(3.0, 4.0), (5.0, 6.0)]
    assert [each.step for each in tail.blocks(0.0, 1)] == ["steps/5"]


def test_a_run_without_anything_has_nothing(empty):
    assert (empty.events(), empty.last_event(), empty.last_reading()) == ([], 0, 0)
    assert (empty.span_s(), empty.blocks(0.0, 5), empty.channels()) == ((0.0, 0.0), [], {})


@pytest.mark.parametrize("readings", [1000])
def test_an_old_reading_is_found_among_many(tmp_path, readings):
    async def main() -> None:
        writer = RunWriter(tmp_path)
        writer.readings("air", "°C", [Valid(float(second), float(second), 1) for second in range(readings)])
        await writer.commit()
        writer.close()

    run(main(), AS_FAST_AS_POSSIBLE)
    with Tail(tmp_path) as tail:
        assert tail.envelope("air", 990.0, 5.0) == [
            Bucket(990.0, 990.0, 994.0, 992.0),
            Bucket(995.0, 995.0, 999.0, 997.0),
        ]
        assert [tail._first_after(at_s) for at_s in (-5.0, 0.5, 500.0, 2000.0)] == [1, 2, 501, 1001]


def test_an_instant_is_as_long_after_the_begin_as_its_bench_time():
    began = datetime.fromisoformat(BEGAN)
    assert instant_at((began, 100.0), 160.5) == began + timedelta(seconds=60.5)
    assert instant_at(None, 160.5) is None
    assert instant_at((began, 100.0), None) is None


def test_a_database_that_cannot_be_read_is_told(written, tmp_path):
    with pytest.raises(StoreError):
        Tail(tmp_path)
    tail = Tail(written)
    tail.__exit__(None, None, None)
    with pytest.raises(StoreError):
        tail.events()

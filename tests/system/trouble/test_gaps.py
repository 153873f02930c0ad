"""Runs on a bad bus: what the journal, the report and a later reduction say did not come is what was dropped."""

import csv
import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.app.execute import RunResult
from bench.engine.state import replayed
from bench.metrology import gaps as missed
from bench.reduce.reduced_again import reduced_again
from bench.reduce.stored_run import open_run
from bench.report.export.export import export_csv
from bench.report.gaps import lines
from bench.report.write import write_report
from bench.runner.commands import state_to_json
from bench.runner.quiet import Quiet
from bench.store.reader import Event, RunReader
from drivers.can import sequence_numbers
from drivers.can.frame_block import FrameBlock
from drivers.dialects.can_counter import wire
from simulators.faults.frame_faults import FaultyFrames, apply_fault
from simulators.instruments.can_nodes import can_node
from tests.support.runs import ROOT, copy_bench, read_json, run_short

AT = "29 s"  # in the second of four acquisitions
LATCH, AXIS_X, SAMPLE = 0x100, 0x101, 0x200
Gaps = list[tuple[int, int]]


@dataclass
class Bus:
    """What was sent in a run, by identifier, and what of it a bad bus has dropped: places in what was sent."""

    sent_at_s: dict[int, list[float]] = field(default_factory=dict)
    dropped: dict[int, set[int]] = field(default_factory=dict)

    def sends(self, block: FrameBlock) -> None:
        for frame_id, at_s in zip(block.ids.tolist(), block.at_s.tolist(), strict=True):
            self.sent_at_s.setdefault(frame_id, []).append(at_s)

    def drops(self, block: FrameBlock, carried: FaultyFrames) -> None:
        for row in sorted(set(range(len(block))) - set(carried.rows.tolist())):
            frame_id = int(block.ids[row])
            place = self.sent_at_s[frame_id].index(float(block.at_s[row]))
            self.dropped.setdefault(frame_id, set()).add(place)

    def gaps(self, begin_s: float, end_s: float, *needed: int) -> Gaps:
        """The rows of frames of which one of the needed was dropped, counted from the first of which the leader came.

        The leader is the first of the needed; after the last of them that came nothing is known.
        """
        leader, *others = needed
        at_s = np.array(self.sent_at_s[leader])
        sent = np.flatnonzero((at_s > begin_s) & (at_s <= end_s)).tolist()
        led = [place for place in sent if place not in self.dropped.get(leader, ())]
        whole = {place for place in led if not any(place in self.dropped.get(other, ()) for other in others)}
        last = led[-1] if led[-1] in whole else led[-1] - 1
        came = [led[0] - 1, *sorted(place for place in whole if place <= last), last + 1]
        return [(before + 1 - led[0], after - 1 - led[0]) for before, after in pairwise(came) if after - before > 1]


def watched_bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    """Every bus of the runs that follow."""
    found, right = Bus(), can_node.CanNode._with_bus_faults

    def sends(self: can_node.CanNode, frames: FrameBlock) -> FrameBlock:
        found.sends(frames)
        return right(self, frames)

    def drops(fault: Any, block: FrameBlock, *others: Any) -> FaultyFrames:
        carried = apply_fault(fault, block, *others)
        found.drops(block, carried)
        return carried

    monkeypatch.setattr(can_node.CanNode, "_with_bus_faults", sends)
    monkeypatch.setattr(can_node, "apply_fault", drops)
    return found


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    return watched_bus(monkeypatch)


def bad(folder: Path, *kinds: str, device: str = "counter", bench: str = "simulated.yaml") -> RunResult:
    faults = ", ".join(f"{{device: {device}, kind: {kind}, at: {AT}}}" for kind in kinds)
    path = copy_bench(folder / "config").with_name(bench)
    path.write_text(path.read_text("utf-8") + (f"  faults: [{faults}]\n" if kinds else ""), "utf-8")
    smoke = (ROOT / "sequences" / "smoke.yaml").read_text("utf-8")
    sequence = folder / "smoke.yaml"  # of whatever measures the output
    sequence.write_text(
        smoke.replace("counter: pulse_counter", "output: output").replace(": counter", ": output"), "utf-8"
    )
    return run_short(folder / "runs", bench=path, sequence=str(sequence))


def events(result: RunResult, kind: str) -> list[Event]:
    with RunReader(result.path) as reader:
        return list(reader.events(kind))


def acquisitions(result: RunResult) -> Iterator[Event]:
    yield from (event for event in events(result, "step_ended") if "label" in event.data)


def as_told(result: RunResult, device: str, *needed: int, bus: Bus) -> int:
    """Holds what is said of channel x of a device against what was dropped; how many gaps there were."""
    entries = {event.step: event.data for event in events(result, "gaps") if event.data["channel"] == "x"}
    in_all = 0
    with open_run(result.path) as run:
        acquired = {each.step: each for each in run.data("tumble").acquisitions}
        reduced = {each.step: json.loads(json.dumps(each.to_json())) for each in run.missed()}
    for event in acquisitions(result):
        true, entry = bus.gaps(event.data["begin_s"], event.data["end_s"], *needed), entries.pop(event.step, None)
        assert (entry is not None) == bool(true), "an entry where something is missing, and nowhere else"
        if entry is None:
            assert event.step not in reduced
            continue
        found = {**acquired[event.step].counts, **acquired[event.step].codes}["x"]
        first = int(found.sequence[0]) - (true[0][1] + 1 if true[0][0] == 0 else 0)
        assert [(begin - first, end - first) for begin, end in found.gaps.tolist()] == true
        listed = [(gap["first"] - first, gap["last"] - first) for gap in entry["listed"]]
        assert listed == true[: missed.MOST_LISTED]
        lost = sum(end - begin + 1 for begin, end in true)
        assert (entry["gaps"], entry["lost"], entry["expected"]) == (len(true), lost, len(found.sequence) + lost)
        assert reduced[event.step] == {"step": event.step, **entry}, "the reduction says the same"
        in_all += len(true)
    assert not entries
    return in_all


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, Bus]:
    with pytest.MonkeyPatch.context() as monkeypatch:
        bus = watched_bus(monkeypatch)
        return bad(tmp_path_factory.mktemp("lossy"), "lost_frames"), bus


def test_what_a_counter_lost_is_what_the_journal_says(lossy: tuple[RunResult, Bus]) -> None:
    result, bus = lossy
    assert result.outcome.how == "completed"
    assert as_told(result, "counter", LATCH, AXIS_X, bus=bus) >= 3


def test_a_very_bad_bus_makes_no_long_journal(tmp_path: Path, bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can_node, "BAD_SHARE", 0.15)
    monkeypatch.setattr("bench.engine.missed.LOOKED_AT_ONCE", 50)
    result = bad(tmp_path, "lost_frames", "lost_bursts")
    assert as_told(result, "counter", LATCH, AXIS_X, bus=bus) > 20
    assert max(event.data["gaps"] for event in events(result, "gaps")) > missed.MOST_LISTED
    assert len(events(result, "gaps")) <= 3 * 3, "one for each channel of an acquisition"
    with open_run(result.path) as run:
        export_csv(run, tmp_path)
    rows = csv.DictReader((tmp_path / "gaps.csv").read_text("utf-8").splitlines())
    found = [(int(row["first"]), int(row["last"])) for row in rows if row["channel"] == "counter.x"]
    with open_run(result.path) as run:
        gaps = [each.counts["x"].gaps.tolist() for each in run.data("tumble").acquisitions]
    assert found == [tuple(gap) for of_acquisition in gaps for gap in of_acquisition], "every gap can be found again"


def test_what_a_unit_sent_and_was_lost_is_what_the_journal_says(tmp_path: Path, bus: Bus) -> None:
    result = bad(tmp_path, "lost_frames", "lost_bursts", device="telemetry", bench="telemetry.yaml")
    assert result.outcome.how == "completed"
    assert as_told(result, "telemetry", SAMPLE, bus=bus) >= 5


def test_a_good_bus_has_nothing_to_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.engine.missed.LOOKED_AT_ONCE", 50)
    monkeypatch.setattr("bench.engine.missed.missed_in_step", None)  # nothing is read back
    result = bad(tmp_path)
    assert events(result, "gaps") == []
    assert "missed" not in read_json(result, "results.json")


# Where it is told


def written(result: RunResult, form: str, lang: str = "en") -> str:
    with open_run(result.path) as run:
        return write_report(run, form, lang).read_text("utf-8")


def test_the_report_tells_of_each_channel_and_each_gap(lossy: tuple[RunResult, Bus]) -> None:
    result, _ = lossy
    found = read_json(result, "results.json")["missed"]
    lost, gaps, expected = (sum(each[key] for each in found) for key in ("lost", "gaps", "expected"))
    page = written(result, "html")
    assert (
        f"<li>counter x: {lost} of {expected} latches lost, in {gaps} gaps of {len(found)} acquisitions. "
        "No mean is left out for this reason.</li>"
    ) in page
    assert page.count('<th scope="row">steps/temperature=20/position=') == len(found) + gaps
    gap = found[0]["listed"][0]
    assert f'<td class="n">{gap["first"]}</td><td class="n">{gap["last"]}</td>' in page
    assert f"counter x：{expected} 个锁存数据中有 {lost} 个未收到" in written(result, "html", "zh")


def test_the_spreadsheet_has_a_line_for_each_acquisition_with_gaps(lossy: tuple[RunResult, Bus]) -> None:
    result, _ = lossy
    rows = [row for row in csv.DictReader(io.StringIO(written(result, "csv"))) if row["quantity"] == "missed_latches"]
    found = read_json(result, "results.json")["missed"]
    assert [(row["id"], row["name"], int(row["value"])) for row in rows] == [
        (each["step"], "counter.x", each["lost"]) for each in found
    ]
    assert rows[0]["at"].startswith("; ".join(f"{gap['first']}-{gap['last']}" for gap in found[0]["listed"]))


def test_a_later_reduction_tells_the_same(lossy: tuple[RunResult, Bus]) -> None:
    result, _ = lossy
    with open_run(result.path) as run:
        again = reduced_again(run)
    assert json.loads(json.dumps(again.to_json()))["missed"] == read_json(result, "results.json")["missed"]
    assert "latches lost, in " in next(iter(again.in_words()))
    assert not again.changes


def test_of_what_no_method_reduces_the_journal_tells(
    lossy: tuple[RunResult, Bus], monkeypatch: pytest.MonkeyPatch
) -> None:
    result, _ = lossy
    with open_run(result.path) as run:
        found = run.missed()
        monkeypatch.setattr(run, "_reduced", list)
        assert run.missed() == found
        assert len(list(lines(found))) == 1


def test_the_technician_is_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    message: list[str] = []
    monkeypatch.setattr(Quiet, "notice", lambda self, text: message.append(text))
    result = bad(tmp_path, "lost_frames", "lost_bursts")
    (text,) = (text for text in message if "frames are missing" in text)
    first = events(result, "gaps")[0]
    assert text.startswith(f"{first.step}: counter: frames are missing: ")
    assert f"{first.data['lost']} of {first.data['expected']} latches of {first.data['channel']}" in text
    with RunReader(result.path) as reader:
        state = state_to_json(replayed(reader.events()))
    assert state["lost"]["counter.x"] == sum(
        event.data["lost"] for event in events(result, "gaps") if event.data["channel"] == "x"
    )


# The test, tested


@pytest.mark.parametrize(
    "wrong", [lambda gaps: gaps[1:], lambda gaps: gaps + np.array([0, 1]), lambda gaps: gaps + np.array([1, 1])]
)
def test_a_gap_that_is_left_out_or_off_by_one_is_noticed(
    lossy: tuple[RunResult, Bus], monkeypatch: pytest.MonkeyPatch, wrong: Callable[[Any], Any]
) -> None:
    result, bus = lossy
    right = sequence_numbers.gaps_in
    monkeypatch.setattr(wire, "gaps_in", lambda *given: wrong(right(*given)))
    with pytest.raises(AssertionError):
        as_told(result, "counter", LATCH, AXIS_X, bus=bus)

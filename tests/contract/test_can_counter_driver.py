"""The driver of the pulse counter on the simulated one, in virtual time."""

import asyncio
import hashlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from bench.metrology.acquisition import Counts
from bench.metrology.pulse_counts import mean_rate
from drivers.can.frame_block import ERROR, FrameBlock
from drivers.capabilities import PulseCounter
from drivers.description import known_drivers
from drivers.dialects.can_counter import wire
from drivers.dialects.can_counter.description import DESCRIPTION, IDLE_BLOCK_S, CounterOptions
from drivers.dialects.can_counter.driver import CanCounter
from drivers.errors import BadAnswer, CannotConnect, InstrumentFault, LinkLost, NoAnswer
from drivers.kinds.frame_source.counter import FIRST_FRAME_S
from drivers.transport.can import PythonCan, Slcan
from simulators.faults.instrument_faults import FaultKind
from tests.support.counters import OPTIONS, RATE_PPS, Bench, dbc_file, options, with_bench, with_driver
from tests.support.laboratory import CHANNELS, ROOT, counter_form

FORM = counter_form()


def now_s() -> float:
    return asyncio.get_running_loop().time()


async def acquired(driver: CanCounter, gate_s: float) -> FrameBlock:
    """What the engine does: records while it waits, and the last block after the exit."""
    found = []
    async with driver.acquire() as blocks:
        with suppress(TimeoutError):
            async with asyncio.timeout(gate_s):
                async for block in blocks:
                    found.append(block)  # noqa: PERF401  a comprehension would lose them at the time-out
    found += [block async for block in blocks]
    return FrameBlock.joined(found)


def latch_times_s(block: FrameBlock) -> Sequence[float]:
    return wire.latches(FORM, block)[1].tolist()


def rate_pps(block: FrameBlock) -> tuple[float, tuple[str, ...]]:
    raw = wire.decode_counts(FORM, "x", block)
    rate = mean_rate(
        Counts(
            raw.sequence, raw.tick, raw.positive, raw.negative, raw.host_s, raw.tick_bits, raw.counter_bits, 1e-6,
            256_000, raw.lost, raw.restarts,
        )
    )  # fmt: skip
    return rate.net_pps, rate.problems


# Connecting


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["can_counter"] is DESCRIPTION
    stated = options()
    assert DESCRIPTION.channels_of(stated) == {"Temperatures.Unit": "°C", "Temperatures.Converter": "°C"}
    assert (stated.period, stated.max_rate, stated.latch.tick_period) == (0.1, 256_000, 1e-6)


def test_signals_that_the_dbc_does_not_have_are_told_with_the_bench_file(tmp_path: Path) -> None:
    wrong = {**CHANNELS, "x": {**CHANNELS["x"], "negative": "AxisX.Negativ"}}
    with pytest.raises(ValidationError, match=r"if_counter.dbc has no signal 'AxisX.Negativ'; .*'AxisX.Negative'"):
        options(channels=wrong)
    outlived = CounterOptions.model_validate(OPTIONS, context={"folder": tmp_path, "files_needed": False})
    assert outlived.dbc == tmp_path / "if_counter.dbc"


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"latch": {**OPTIONS["latch"], "tick": "AxisX.Sequence"}}, "'AxisX.Sequence' is not in Latch, where the sequ"),
        ({"channels": {"x": {**CHANNELS["x"], "negative": "AxisY.Negative"}}}, "'AxisY.Negative' is not in AxisX, whe"),
        ({"channels": {"x": {**CHANNELS["x"], "sequence": "Latch.Sequence"}}}, "'AxisX.Positive' is not in Latch, whe"),
        ({"channels": {"x": {**CHANNELS["x"], "negative": "AxisX.Sequence"}}}, "'AxisX.Sequence' has 16 bits, 'AxisX"),
    ],
)
def test_signals_that_belong_together_are_in_one_frame_and_come_round_alike(changes: dict, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        options(**changes)


def test_it_is_identified_by_its_frames_and_what_the_bench_file_states() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        assert isinstance(driver, PulseCounter)
        identity = await driver.identify()
        dbc = (ROOT / "config" / "if_counter.dbc").read_bytes()
        assert (identity.serial, identity.verified) == ("IFC-01", False)
        assert identity.fingerprint == f"dbc sha256:{hashlib.sha256(dbc).hexdigest()[:16]}"
        await driver.make_safe()
        await driver.make_safe()

    with_driver(use)


def test_it_connects_with_the_first_latch() -> None:
    async def use(bench: Bench) -> None:
        async with bench.driver():
            assert 0.1 <= now_s() <= 0.2
        assert bench.bus.closed == 1

    with_bench(use)


def test_a_channel_that_cannot_be_opened_is_told() -> None:
    async def use(bench: Bench) -> None:
        bench.bus.refuses = True
        with pytest.raises(CannotConnect, match="counter: cannot open"):
            await bench.driver().__aenter__()

    with_bench(use)


def test_a_bus_without_a_frame_is_told_with_what_to_check() -> None:
    async def use(bench: Bench) -> None:
        bench.faults.begin("silent")
        with pytest.raises(
            NoAnswer, match=r"no Latch frame \(0x100\) within 3 s on slcan:.*no frame at all.*bit rate is right"
        ):
            await bench.driver().__aenter__()
        assert now_s() == pytest.approx(FIRST_FRAME_S, abs=0.2)
        assert bench.bus.closed == 1

    with_bench(use)


def test_the_dbc_of_another_counter_is_told_with_the_frames_that_come(tmp_path: Path) -> None:
    dbc_file(tmp_path, ("BO_ 256 Latch", f"BO_ {0x18FF0100 | 1 << 31} Latch"), ("CM_ BO_ 256", "// "),
                   ("CM_ SG_ 256", "// "))  # fmt: skip

    async def use(bench: Bench) -> None:
        with pytest.raises(NoAnswer, match=r"no Latch frame \(0x18ff0100\).*received 0x100, 0x101, .*such as the DBC"):
            await bench.driver(tmp_path).__aenter__()

    with_bench(use)


def test_a_dbc_without_the_signals_of_the_bench_file_is_told(tmp_path: Path) -> None:
    """It was edited after the bench file had been checked."""
    dbc = dbc_file(tmp_path)

    async def use(bench: Bench) -> None:
        driver = bench.driver(tmp_path)
        dbc_file(tmp_path, ("SG_ Tick", "SG_ Tock"))
        with pytest.raises(BadAnswer, match=r"counter: if_counter.dbc: message Latch has no signal 'Tick'.*bench file"):
            await driver.__aenter__()
        dbc.write_text("nonsense", "utf-8")
        with pytest.raises(BadAnswer, match=r"counter: if_counter.dbc: not a usable DBC"):
            await driver.__aenter__()
        assert bench.bus.closed == 0, "it was never opened"

    with_bench(use)


def test_cancelling_while_it_connects_lets_the_channel_go() -> None:
    async def use(bench: Bench) -> None:
        bench.faults.begin("silent")
        connecting = asyncio.create_task(bench.driver().__aenter__())
        await asyncio.sleep(1)
        connecting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await connecting
        assert bench.bus.closed == 1

    with_bench(use)


# Readings


def test_it_tells_when_there_is_something_to_poll() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        for _ in range(3):
            await driver.wait_for_data()
            newest_s = (await driver.poll())["Temperatures.Unit"][-1].at_s
            assert now_s() - newest_s <= 1.0, "a reading is there as soon as its frame has been taken in"
            reported_s = now_s()
        async with driver.acquire(block_s=1.0):
            await driver.wait_for_data()
            await driver.wait_for_data()
        assert now_s() - reported_s <= 2.0, "also as often as somebody acquires"

    with_driver(use)


def test_temperatures_are_readings_with_their_times() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        await asyncio.sleep(60)
        readings = await driver.poll()
        assert set(readings) == {"Temperatures.Unit", "Temperatures.Converter"}
        assert {reading.value for reading in readings["Temperatures.Converter"]} == {25.0}
        times = [reading.at_s for reading in readings["Temperatures.Unit"]]
        assert np.diff(times) == pytest.approx(np.ones(len(times) - 1)), "there is one every second"
        assert now_s() - times[-1] <= 1.0, "also of those that have not been taken in yet"
        assert await driver.poll() == {}, "each is handed out once"

    with_driver(use)


def test_no_reading_is_lost_or_doubled_by_an_acquisition() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        times: list[float] = []

        async def watch() -> None:
            while True:
                times.extend(r.at_s for r in (await driver.poll()).get("Temperatures.Unit", ()))
                await asyncio.sleep(1)

        watching = asyncio.create_task(watch())
        await asyncio.sleep(33.3)
        await acquired(driver, 17.7)
        await asyncio.sleep(30)
        watching.cancel()
        assert len(times) >= 70
        assert np.diff(times) == pytest.approx(np.ones(len(times) - 1))

    with_driver(use)


# Acquisition


@pytest.mark.parametrize("idle_s", [0.0, 3.33, 9.99, 10.0, 25.05])
@pytest.mark.parametrize("gate_s", [0.25, 1.0, 10.0, 47.7])
def test_an_acquisition_holds_the_frames_between_entry_and_exit(idle_s: float, gate_s: float) -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        await asyncio.sleep(idle_s)
        entry_s = now_s()
        block = await acquired(driver, gate_s)
        assert now_s() == pytest.approx(entry_s + gate_s)
        assert block.at_s.min() > entry_s - 1e-9
        assert block.at_s.max() <= now_s() + 1e-9
        times = latch_times_s(block)
        assert times[0] <= entry_s + 0.1 + 1e-6
        assert times[-1] >= now_s() - 0.1 - 1e-6
        assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 0.1))
        rate, problems = rate_pps(block)
        assert (rate, problems) == (pytest.approx(RATE_PPS, abs=1 / (gate_s - 0.2)), ())

    with_driver(use)


def test_blocks_come_every_second_while_somebody_acquires() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        await asyncio.sleep(12.3)
        arrived = []
        async with driver.acquire() as blocks:
            async for block in blocks:
                arrived.append(now_s() - 12.4)
                assert len(wire.latches(FORM, block)[0]) in (9, 10, 11)
                if len(arrived) == 5:
                    break
        assert np.diff(arrived) == pytest.approx(np.ones(4))

    with_driver(use)


@pytest.mark.parametrize(("link_s", "asked_s", "every_s"), [(10.0, None, 10.0), (10.0, 2.0, 2.0), (1.0, 5.0, 1.0)])
def test_blocks_come_as_often_as_the_link_or_whoever_acquires_needs_them(
    link_s: float, asked_s: float | None, every_s: float
) -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        bench.bus.block_s = link_s
        arrived = []
        async with driver.acquire() if asked_s is None else driver.acquire(block_s=asked_s) as blocks:
            async for _ in blocks:
                arrived.append(now_s())
                if len(arrived) == 4:
                    break
        assert np.diff(arrived) == pytest.approx(np.full(3, every_s))

    with_driver(use)


@pytest.mark.parametrize(("link_s", "every_s"), [(1.0, IDLE_BLOCK_S), (10.0, 10.0), (30.0, 30.0)])
def test_while_nobody_acquires_frames_are_left_together_longer(link_s: float, every_s: float) -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        bench.bus.block_s = link_s
        await driver.wait_for_data()  # of the wait that had begun before
        heard_s = []
        for _ in range(3):
            await driver.wait_for_data()
            heard_s.append(now_s())
        assert np.diff(heard_s) == pytest.approx(np.full(2, every_s))
        await asyncio.sleep(3)
        driver.drain()
        await driver.wait_for_data()
        assert now_s() == pytest.approx(heard_s[-1] + 3), "whoever needs them sooner gets them"

    with_driver(use)


def test_a_power_cut_costs_a_second_of_real_frames_at_most() -> None:
    assert (Slcan.block_s, PythonCan.block_s) == (1.0, 1.0)


def test_acquisitions_follow_one_another_without_a_frame_in_both() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        first, second = await acquired(driver, 5.0), await acquired(driver, 5.0)
        assert len(latch_times_s(first)) in (49, 50, 51)
        assert latch_times_s(second)[0] - latch_times_s(first)[-1] == pytest.approx(0.1)
        assert wire.decode_counts(FORM, "x", FrameBlock.joined([first, second])).lost == 0

    with_driver(use)


def test_one_acquisition_at_a_time() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        async with driver.acquire() as blocks:
            with pytest.raises(InstrumentFault, match="counter: an acquisition is already running"):
                await driver.acquire().__aenter__()
            assert len(await anext(blocks)) > 0, "the first goes on"
        assert len(await acquired(driver, 1.0)) > 0

    with_driver(use)


def test_polling_goes_on_while_it_acquires() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        async with driver.acquire() as blocks:
            await asyncio.sleep(10.5)
            readings = await driver.poll()
            assert len(readings["Temperatures.Unit"]) >= 9
            kept = FrameBlock.joined([await anext(blocks) for _ in range(9)])
            assert len(wire.temperatures(FORM, kept)["Temperatures.Unit"][0]) >= 8, "and they are in the blocks too"

    with_driver(use)


def test_cancelling_in_mid_acquisition_leaves_the_counter_ready() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        task = asyncio.create_task(acquired(driver, 1000))
        await asyncio.sleep(5)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert len(latch_times_s(await acquired(driver, 2.0))) in (19, 20, 21)
        assert (await driver.poll())["Temperatures.Unit"]

    with_driver(use)


def test_an_ended_iterator_stays_ended() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        async with driver.acquire() as blocks:
            pass
        for _ in range(2):
            assert [block async for block in blocks] == []

    with_driver(use)


def test_hours_of_idling_keep_no_frames() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        for _ in range(3):
            await asyncio.sleep(3600)
            assert len((await driver.poll())["Temperatures.Unit"]) in (3590, 3600, 3610)
        assert len(latch_times_s(await acquired(driver, 5.0))) in (49, 50, 51)

    with_driver(use)


# Frames that are not as they should be


def without_rows(block: FrameBlock, drop: np.ndarray) -> FrameBlock:
    return FrameBlock(block.ids[~drop], block.at_s[~drop], block.dlc[~drop], block.data[~drop])


def test_an_acquisition_may_begin_in_the_middle_of_a_latch() -> None:
    """The latch frame and one axis were sent before the entry."""

    async def use(bench: Bench, driver: CanCounter) -> None:
        await asyncio.sleep(5)
        begun = False

        def alter(block: FrameBlock) -> FrameBlock:
            nonlocal begun
            drop = np.zeros(len(block), dtype=bool)
            if len(block) and now_s() > 5.2 and not begun:
                drop[:2], begun = True, True
            return without_rows(block, drop)

        bench.bus.alter = alter
        block = await acquired(driver, 10.0)
        assert block.ids[0] == 0x102
        assert wire.decode_counts(FORM, "z", block).lost == 0
        assert rate_pps(block) == (pytest.approx(RATE_PPS, abs=0.1), ())

    with_driver(use)


def test_lost_frames_cost_no_accuracy() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        draws = np.random.default_rng(5)
        bench.bus.alter = lambda block: without_rows(block, draws.random(len(block)) < 0.1)
        block = await acquired(driver, 60.0)
        counts = wire.decode_counts(FORM, "x", block)
        assert 50 < counts.lost < 180
        assert rate_pps(block) == (pytest.approx(RATE_PPS, abs=1 / 58), ())

    with_driver(use)


# Faults


def fails_with(kind: FaultKind, error: type[Exception], message: str) -> None:
    """In mid-acquisition: what came before is handed out, then the error; afterwards everything says so."""

    async def use(bench: Bench, driver: CanCounter) -> None:
        found: list[FrameBlock] = []

        async def record() -> None:
            async with driver.acquire() as blocks:
                async for block in blocks:
                    found.append(block)  # noqa: PERF401  nor at a fault

        task = asyncio.create_task(record())
        await asyncio.sleep(5.05)
        bench.faults.begin(kind)
        with pytest.raises(error, match=message):
            await task
        assert now_s() < 5.05 + 4.0, "in bounded time"
        assert len(latch_times_s(FrameBlock.joined(found))) >= 40
        assert bench.bus.closed == 1, "frames that nobody takes do not pile up"
        for again in (driver.poll, driver.acquire().__aenter__):
            with pytest.raises(error, match=message):
                await again()

    with_driver(use)


def test_a_counter_that_falls_silent() -> None:
    fails_with("silent", NoAnswer, r"counter: counter frames have stopped: none for more than 2.5 s\. Check")


def test_fast_latches_that_are_held_back_for_a_moment_have_not_stopped() -> None:
    async def use(bench: Bench) -> None:
        async with bench.driver(period="1 ms") as driver:  # they come every 100 ms, as if an adapter collected them
            assert len(latch_times_s(await acquired(driver, 2.05))) == 20

    with_bench(use)


def test_a_counter_that_stands_still() -> None:
    fails_with("frozen", InstrumentFault, r"counter: the counter is frozen: its latches .* number \d+\. Restart")


def test_a_connection_that_is_cut() -> None:
    fails_with("cut", LinkLost, r"counter: the connection was cut\. Check the cable")


@pytest.mark.parametrize("waits", ["for a second", "for data"])
@pytest.mark.parametrize("kind", ["silent", "frozen", "cut"])
def test_idle_faults_are_raised_by_the_poll(kind: FaultKind, waits: str) -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        await asyncio.sleep(33)
        bench.faults.begin(kind)

        async def watch() -> None:
            while True:
                await driver.poll()
                await (driver.wait_for_data() if waits == "for data" else asyncio.sleep(1))

        with pytest.raises((NoAnswer, InstrumentFault, LinkLost)):
            await watch()
        assert now_s() <= 33 + 2 * IDLE_BLOCK_S + 1

    with_driver(use)


@pytest.mark.parametrize("kind", ["silent", "cut"])
def test_a_fault_that_is_found_at_the_entry_is_raised_there(kind: FaultKind) -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        await asyncio.sleep(30.5)  # the intake has just looked
        bench.faults.begin(kind)
        await asyncio.sleep(5)
        with pytest.raises((NoAnswer, LinkLost)):
            await driver.acquire().__aenter__()

    with_driver(use)


def test_a_fault_that_is_found_at_the_exit_ends_the_iteration() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        async with driver.acquire() as blocks:
            await asyncio.sleep(0.5)
            bench.faults.begin("cut")
        for _ in range(2):
            with pytest.raises(LinkLost):
                await anext(blocks)

    with_driver(use)


def test_a_slow_counter_that_stands_still_is_seen_over_blocks_of_one_latch() -> None:
    async def use(bench: Bench) -> None:
        bench.bus.alter = lambda block: without_rows(block, (np.rint(block.at_s * 10) % 10).astype(int) != 0)
        async with bench.driver(period="1 s") as driver:
            bench.faults.begin("frozen")
            with pytest.raises(InstrumentFault, match="is frozen"):
                await acquired(driver, 100)
            assert now_s() < 10

    with_bench(use)


def test_a_restart_goes_on_and_is_in_the_counts() -> None:
    """The driver hands out what comes; the reading is not used (equations 1.7)."""

    async def use(bench: Bench, driver: CanCounter) -> None:
        async def restart() -> None:
            await asyncio.sleep(20)
            bench.faults.begin("restart")

        restarting = asyncio.create_task(restart())
        block = await acquired(driver, 40.0)
        await restarting
        assert wire.decode_counts(FORM, "x", block).restarts == 1
        assert "counter_restarted" in rate_pps(block)[1]
        assert rate_pps(await acquired(driver, 10.0)) == (pytest.approx(RATE_PPS, abs=0.2), ())

    with_driver(use)


# A lost link


def test_a_poll_connects_again_when_the_link_was_lost_and_says_so() -> None:
    async def use(bench: Bench) -> None:
        async with bench.driver() as driver:
            await asyncio.sleep(12)
            bench.bus.gone = True
            task = asyncio.create_task(acquired(driver, 10))
            await asyncio.sleep(1)
            with pytest.raises(LinkLost, match="the adapter is gone"):
                await task
            with pytest.raises(LinkLost, match="the adapter is gone"):
                await driver.poll()
            attempts = bench.bus.opened
            with pytest.raises(LinkLost, match="the adapter is gone"):
                await driver.poll()
            assert bench.bus.opened == attempts, "it is not time yet"
            bench.bus.gone = False
            with pytest.raises(LinkLost, match="the adapter is gone"):
                await acquired(driver, 10)
            await asyncio.sleep(1)
            await driver.poll()
            assert bench.notes == ["connected again at slcan:///dev/ttyACM0?bitrate=500000"]
            assert wire.decode_counts(FORM, "x", await acquired(driver, 5.0)).lost == 0

    with_bench(use)


@pytest.mark.parametrize(
    ("classes", "message"), [(0x040, r"or was, bus-off \(bus off\)"), (0x100, "controller restarted")]
)
def test_no_block_goes_over_a_bus_that_was_off(classes: int, message: str) -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        bench.bus.alter = lambda block: with_error(block, classes) if now_s() > 5 else block
        found: list[FrameBlock] = []

        async def record() -> None:
            async with driver.acquire() as blocks:
                async for block in blocks:
                    found.append(block)  # noqa: PERF401  nor at a fault

        with pytest.raises(LinkLost, match=message):
            await record()
        assert (FrameBlock.joined(found).ids == (ERROR | classes)).sum() == 1, "it is recorded too"

    with_driver(use)


def test_other_error_frames_are_recorded_and_told_once_a_minute() -> None:
    async def use(bench: Bench, driver: CanCounter) -> None:
        bench.bus.alter = lambda block: with_error(block, 0x008)
        block = await acquired(driver, 90.0)
        assert (block.ids == (ERROR | 0x008)).sum() >= 89
        assert rate_pps(block) == (pytest.approx(RATE_PPS, abs=1 / 89), ())
        assert bench.notes[0] == "error frames on the bus: 1, protocol violation"
        assert len(bench.notes) == 2

    with_driver(use)


def test_error_frames_are_told_where_no_latch_comes() -> None:
    async def use(bench: Bench) -> None:
        bench.bus.alter = lambda block: with_error(FrameBlock.empty(), 0x020)
        with pytest.raises(NoAnswer, match=r"received error frames \(no acknowledgement\)"):
            await bench.driver().__aenter__()

    with_bench(use)


def with_error(block: FrameBlock, classes: int) -> FrameBlock:
    """A block with an error frame after it."""
    error = FrameBlock(
        np.array([ERROR | classes], np.uint32), np.array([now_s()]), np.array([8], np.uint8), np.zeros((1, 8), np.uint8)
    )
    return FrameBlock.joined([block, error])


# Through a serial-line adapter


def test_through_a_serial_line_adapter_it_is_the_same() -> None:
    async def use(bench: Bench) -> None:
        bench.bus.by_adapter = True
        async with bench.driver() as driver:
            await asyncio.sleep(3)
            block = await acquired(driver, 30.0)
            assert len(latch_times_s(block)) in (299, 300, 301)
            assert rate_pps(block) == (pytest.approx(RATE_PPS, abs=1 / 29), ())
            bench.faults.begin("cut")
            with pytest.raises(LinkLost, match="counter: the CAN adapter has closed the connection"):
                await acquired(driver, 30.0)

    with_bench(use)

"""The telemetry of units, against units that send: opening, silence without power, acquisition, faults."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.metrology.sampled_codes import has_restarted
from drivers.can.frame_block import FrameBlock
from drivers.can.options import IDLE_BLOCK_S
from drivers.capabilities import Telemetry
from drivers.dialects.can_telemetry.decoder import TelemetryDecoder
from drivers.dialects.can_telemetry.description import DESCRIPTION, TelemetryOptions
from drivers.dialects.can_telemetry.driver import CanTelemetry
from drivers.errors import BadAnswer, CannotConnect, InstrumentFault, LinkLost, NoAnswer
from simulators.faults.instrument_faults import FaultKind
from tests.support.capabilities import CAPABILITIES
from tests.support.telemetry import CHANNELS, CODES_PER_G, Bench, options, with_bench, with_driver

HALF_G = CODES_PER_G / 2


def now_s() -> float:
    return asyncio.get_running_loop().time()


async def acquired(driver: CanTelemetry, gate_s: float) -> FrameBlock:
    async with driver.acquire() as blocks:
        await asyncio.sleep(gate_s)
    return FrameBlock.joined([block async for block in blocks])


def decoded(block: FrameBlock, channel: str = "x"):
    found = options()
    return TelemetryDecoder(found).outputs(block)[channel]


def changed(bench: Bench, alter: Callable[[FrameBlock], np.ndarray]) -> None:
    """Lets the rows of frames through that `alter` gives, in its order."""

    def through(block: FrameBlock) -> FrameBlock:
        rows = alter(block)
        return FrameBlock(block.ids[rows], block.at_s[rows], block.dlc[rows], block.data[rows])

    bench.bus.alter = through


# Opening


def test_it_is_telemetry() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        assert isinstance(driver, Telemetry)
        assert CAPABILITIES["telemetry"] is Telemetry
        assert DESCRIPTION.capabilities == {"telemetry"}
        identity = await driver.identify()
        assert (identity.serial, identity.verified) == ("ACC-01", False)
        assert identity.fingerprint.startswith("dbc sha256:")
        await driver.make_safe()

    with_driver(use)


def test_a_bus_that_cannot_be_opened_is_told() -> None:
    async def use(bench: Bench) -> None:
        bench.bus.refuses = True
        with pytest.raises(CannotConnect):
            await bench.driver().__aenter__()

    with_bench(use)


def test_a_dbc_that_was_edited_after_the_bench_file_was_checked_is_told(tmp_path: Path) -> None:
    text = options().dbc.read_text("utf-8")
    (tmp_path / "telemetry.dbc").write_text(text, "utf-8")

    async def use(bench: Bench) -> None:
        driver = bench.driver(tmp_path)
        (tmp_path / "telemetry.dbc").write_text(text.replace("SG_ Code", "SG_ Kode"), "utf-8")
        with pytest.raises(BadAnswer, match=r"telemetry\.dbc: message AccX has no signal 'Code'.*bench file"):
            await driver.__aenter__()
        assert bench.bus.closed == 0, "it was never opened"

    with_bench(use)


def test_a_unit_without_power_may_be_silent_until_somebody_acquires() -> None:
    async def use(bench: Bench) -> None:
        bench.world.power("supply", False)
        async with bench.driver() as driver:
            await asyncio.sleep(100)
            assert await driver.poll() == {}
            assert driver.last_seen()["x"].frame_s < 0
            with pytest.raises(
                NoAnswer, match=r"no sample \(0x200, 0x201\) for more than 1.25 s.*no other frame.*unit is on"
            ):
                await acquired(driver, 10)
            with pytest.raises(NoAnswer):
                await driver.poll()

    with_bench(use)


def test_frames_of_another_dbc_are_named() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        bench.bus.alter = lambda block: FrameBlock(block.ids + np.uint32(16), block.at_s, block.dlc, block.data)
        with pytest.raises(NoAnswer, match=r"received 0x210, 0x211, 0x220 besides.*DBC belongs to this unit"):
            await acquired(driver, 10)

    with_driver(use)


# Samples


def test_what_is_acquired_is_what_the_units_send() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        await asyncio.sleep(3.3)
        block = await acquired(driver, 10.0)
        assert block.at_s.min() > 3.3 - 1e-9
        assert block.at_s.max() <= now_s() + 1e-9
        for channel, count, period_s in (("x", 500, 0.02), ("y", 200, 0.05)):
            codes = decoded(block, channel)
            assert abs(len(codes.values) - count) <= 1
            assert set(codes.values.tolist()) == {HALF_G}
            assert np.diff(codes.host_s) == pytest.approx(np.full(len(codes.values) - 1, period_s))
            assert set((np.diff(codes.tick) % 2**24).tolist()) == {round(period_s / 1e-5)}
            assert (codes.lost, codes.dropped, codes.invalid) == (0, 0, 0)

    with_driver(use)


def test_noise_is_in_whole_codes() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        values = decoded(await acquired(driver, 60.0)).values
        assert np.array_equal(values, np.rint(values))
        assert values.mean() == pytest.approx(HALF_G, abs=4 * 3 / np.sqrt(len(values)))
        assert values.std() == pytest.approx(np.hypot(3, 12**-0.5), rel=0.1)

    with_driver(use, noise="3 code")


def test_the_unit_has_a_clock_of_its_own() -> None:
    """It says that 20 ms have passed, and 20.02 ms have."""

    async def use(bench: Bench, driver: CanTelemetry) -> None:
        codes = decoded(await acquired(driver, 60.0))
        assert np.diff(codes.host_s).mean() == pytest.approx(0.02 * 1.001, rel=1e-6)
        assert set((np.diff(codes.tick) % 2**24).tolist()) == {2000}

    with_driver(use, clock="-999.001 ppm")


def test_temperatures_are_readings() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        await asyncio.sleep(30.5)
        readings = (await driver.poll())["Housekeeping.Sensor"]
        assert len(readings) in range(19, 31)
        assert {round(reading.value) for reading in readings} == {20}
        assert now_s() - readings[-1].at_s <= IDLE_BLOCK_S + 1
        assert await driver.poll() == {}

    with_driver(use)


def test_what_was_heard_last_is_known() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        await acquired(driver, 20.0)
        seen = driver.last_seen()
        assert now_s() - seen["x"].frame_s <= 0.02
        assert seen["x"].change_s < 1.0, "its code has not changed since the first sample"

    with_driver(use)


def test_a_unit_begins_anew_when_it_is_switched_on() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        await asyncio.sleep(5.0)
        bench.world.power("supply", False)
        await asyncio.sleep(100.0)
        bench.world.power("supply", True)
        codes = decoded(await acquired(driver, 2.0))
        assert codes.sequence[:3].tolist() == [1, 2, 3]
        assert codes.tick[0] == 2000
        assert len(codes.values) in (99, 100)

    with_driver(use)


# Frames that are not as they should be


def test_lost_frames_are_counted() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        draws = np.random.default_rng(5)
        changed(bench, lambda block: np.flatnonzero(draws.random(len(block)) > 0.1))
        codes = decoded(await acquired(driver, 60.0))
        assert 200 < codes.lost < 400
        assert len(codes.values) + codes.lost == pytest.approx(3000, abs=3)
        assert set(codes.values.tolist()) == {HALF_G}

    with_driver(use)


def test_doubled_and_late_frames_are_dropped() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        changed(bench, lambda block: np.repeat(np.arange(len(block)), 2))
        codes = decoded(await acquired(driver, 10.0))
        assert codes.dropped == len(codes.values)
        changed(bench, lambda block: np.arange(len(block)).reshape(-1, 1)[::-1].ravel())
        codes = decoded(await acquired(driver, 10.0))
        assert codes.dropped > 400, "in each block the last came first"

    with_driver(use)


def test_a_restart_goes_on_and_is_in_the_samples() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        async def restart() -> None:
            await asyncio.sleep(20.3)
            bench.faults.begin("restart")

        restarting = asyncio.create_task(restart())
        codes = decoded(await acquired(driver, 40.0))
        await restarting
        assert codes.restarts == 1
        assert has_restarted(codes)
        assert (np.diff(decoded(await acquired(driver, 10.0)).tick) == 2000).all()

    with_driver(use)


# Faults


def fails_with(kind: FaultKind, error: type[Exception], message: str) -> None:
    """In mid-acquisition: what came before is handed out, then the error; afterwards everything says so."""

    async def use(bench: Bench, driver: CanTelemetry) -> None:
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
        assert len(decoded(FrameBlock.joined(found)).values) >= 200
        assert bench.bus.closed == 1, "frames that nobody takes do not pile up"
        for again in (driver.poll, driver.acquire().__aenter__):
            with pytest.raises(error, match=message):
                await again()

    with_driver(use)


def test_units_that_fall_silent() -> None:
    fails_with("silent", NoAnswer, r"telemetry: no sample \(0x200, 0x201\) for more than 1.25 s during an acquisition")


def test_a_unit_that_repeats_one_sample() -> None:
    fails_with("frozen", InstrumentFault, r"telemetry: channel 'x' is frozen: .* number \d+\. Switch the unit off")


def test_a_connection_that_is_cut() -> None:
    fails_with("cut", LinkLost, r"telemetry: the connection was cut\. Check the cable")


def test_one_channel_that_falls_silent_is_not_the_others_fault() -> None:
    async def use(bench: Bench, driver: CanTelemetry) -> None:
        bench.world.units["b"].faults.begin("silent")
        block = await acquired(driver, 10.0)
        assert len(decoded(block).values) >= 499
        assert len(decoded(block, "y").values) == 0
        assert driver.last_seen()["y"].frame_s < driver.last_seen()["x"].frame_s

    with_driver(use)


def test_through_a_serial_line_adapter_it_is_the_same() -> None:
    async def use(bench: Bench) -> None:
        bench.bus.by_adapter = True
        async with bench.driver() as driver:
            await asyncio.sleep(3)
            codes = decoded(await acquired(driver, 10.0))
            assert len(codes.values) in (499, 500, 501)
            assert codes.lost == 0
            assert set(codes.values.tolist()) == {HALF_G}
        await asyncio.sleep(0.1)  # the adapter sees that its line is closed

    with_bench(use)


# What a bench file may say


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"value": "AccX.Kode"}, r"telemetry.dbc has no signal 'AccX.Kode'; did you mean 'AccX.Code'\?"),
        ({"tick": "AccY.Tick"}, "'AccY.Tick' is not in AccX, where the value is"),
        ({"value": "Housekeeping.Sensor", "tick": "Housekeeping.Board", "sequence": "Housekeeping.Board",
          "status": None, "unit": "g"}, "'Housekeeping.Sensor' is in '°C' in telemetry.dbc"),
        ({"unit": "furlong"}, "'furlong' is not a known unit"),
        ({"tick_period": "100 ns"}, r"'AccX.Tick' wraps around after 1.67772 s; .* gaps of up to 2.56 s"),
        ({"invalid_bits": 0}, "at least 1"),
        ({"stuck_after": 1}, "at least 2"),
    ],
)  # fmt: skip
def test_options_that_do_not_go_together_are_told(change: dict, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        options(channels={"x": CHANNELS["x"] | change})


def test_a_channel_may_be_decoded_to_a_unit() -> None:
    found = options(channels={"x": CHANNELS["x"] | {"unit": "m/s²"}})
    assert isinstance(found, TelemetryOptions)
    assert (found.channels["x"].output.unit, options().channels["x"].output.unit) == ("m/s²", "code")

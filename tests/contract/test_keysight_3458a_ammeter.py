"""The Keysight 3458A as an ammeter in the cable of a current source, against the simulated one, in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydantic import ValidationError

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.capabilities import Ammeter
from drivers.description import IdentityPin, Nothing, Setup, known_drivers, make_driver
from drivers.dialects.keysight_3458a.ammeter import DESCRIPTION, AmmeterOptions
from drivers.dialects.keysight_3458a.driver import Keysight3458AAmmeter
from drivers.errors import InstrumentFault
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.meters.keysight_3458a import Simulated3458A
from simulators.instruments.meters.meter_inputs import CurrentInSeries
from simulators.physics.source_errors import CurrentErrors, Feed
from tests.support.lines import TappedWire
from tests.support.voltmeter import a_world

SET_UP = b"PRESET NORM;TARM HOLD;TRIG AUTO;INBUF ON;END ALWAYS;QFORMAT NORM;DCI 0.001;NPLC 10;AZERO ON;TARM?\n"


@dataclass
class SetTo:
    """What a source is set to."""

    feeds_a: float | None = 1e-3
    load_ohm: float = 100.0


class Bench:
    """A source, and a simulated ammeter in its cable behind a tapped wire."""

    def __init__(self, *, noise: float = 0.0, line_hz: float = 50.0, **errors: float) -> None:
        now_s = asyncio.get_running_loop().time
        self.world, self.source = a_world(now_s), SetTo()
        self.world.sources["source"] = Feed(self.source, CurrentErrors())
        in_series = CurrentInSeries(self.world, "source", CurrentErrors(fresh=1.0, **errors), noise=noise)
        self.instrument = Simulated3458A(self.world, FaultPlan(now_s=now_s), in_series, line_hz=line_hz)
        self.wire = TappedWire(self.instrument)

    def set(self, feeds_a: float | None) -> None:
        self.world.before_change()
        self.source.feeds_a = feeds_a

    def driver(self, full_scale: str = "1 mA") -> Keysight3458AAmmeter:
        setup = Setup(
            name="dmm", address=Address.parse("tcp://127.0.0.1:1234"), wires=self.wire,
            options=AmmeterOptions.model_validate({"range": full_scale}), limits=Nothing(), safe=Nothing(),
            identity=IdentityPin(model="3458A", serial="US28031235"),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, Keysight3458AAmmeter)
        return driver


def with_driver(
    use: Callable[[Bench, Keysight3458AAmmeter], Awaitable[None]], *, full_scale: str = "1 mA", **settings: float
) -> None:
    async def main() -> None:
        bench = Bench(**settings)
        async with bench.driver(full_scale) as driver:
            await use(bench, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["keysight_3458a_ammeter"] is DESCRIPTION
    options = AmmeterOptions.model_validate({"range": "10 mA"})
    assert (options.range, options.nplc, options.burden_ohm) == (1e-2, 10, pytest.approx(10))
    assert DESCRIPTION.channels_of(options) == {"current": "A"}


@pytest.mark.parametrize(("full_scale", "problem"), [("2 mA", "is 0.002 A, expected 100 nA, 1 µA"), ("1 V", "in A")])
def test_a_wrong_range_is_told(full_scale: str, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        AmmeterOptions.model_validate({"range": full_scale})


def test_it_is_set_up_for_current_and_that_is_read_back_before_every_measurement() -> None:
    async def use(bench: Bench, driver: Keysight3458AAmmeter) -> None:
        assert isinstance(driver, Ammeter)
        assert SET_UP in bench.wire.requests
        bench.wire.requests.clear()
        readings = await driver.measure(2, nplc=None)
        assert [reading.value for reading in readings] == pytest.approx([1e-3] * 2, rel=1e-9)
        assert bench.wire.requests == [
            b"TARM?\n", b"FUNC?\n", b"NPLC?\n", b"AZERO?\n", b"MATH?\n", b"INBUF?\n", *[b"TARM SGL\n"] * 2,
            b"ERRSTR?\n",
        ]  # fmt: skip
        assert list(await driver.poll()) == ["current"]

    with_driver(use)


@pytest.mark.parametrize("full_scale", ["100 nA", "1 µA", "10 µA", "100 µA", "1 mA", "10 mA", "100 mA", "1 A"])
def test_every_range_is_taken_and_read_back(full_scale: str) -> None:
    async def use(bench: Bench, driver: Keysight3458AAmmeter) -> None:
        most_a = bench.instrument.full_scale
        assert most_a is not None
        bench.set(-most_a)
        assert (await driver.measure(1, nplc=1))[0].value == pytest.approx(-most_a)
        bench.set(1.25 * most_a)
        with pytest.raises(InstrumentFault, match=rf"input is beyond the {most_a:g} A range; received 1e\+38"):
            await driver.measure(1, nplc=1)

    with_driver(use, full_scale=full_scale)


def test_it_reads_what_flows_with_its_errors_and_its_noise() -> None:
    async def use(bench: Bench, driver: Keysight3458AAmmeter) -> None:
        read = np.array([reading.value for reading in await driver.measure(200, nplc=10)])
        assert np.mean(read) == pytest.approx(1e-3 * (1 + 50e-6) + 20e-9, abs=1.5e-9)
        assert np.std(read) == pytest.approx(5e-9, rel=0.2)
        bench.set(None)
        assert abs((await driver.measure(1, nplc=10))[0].value - 20e-9) < 20e-9, "off: its offset alone"

    with_driver(use, gain=50e-6, offset_a=20e-9, noise=5e-9)


def test_a_current_that_changes_during_a_reading_is_averaged() -> None:
    async def use(bench: Bench, driver: Keysight3458AAmmeter) -> None:
        measuring = asyncio.create_task(driver.measure(1, nplc=10))
        await asyncio.sleep(0.11)  # the questions before, and half of the 0.2 s of its aperture
        bench.set(1.1e-3)
        (reading,) = await measuring
        assert reading.value == pytest.approx(1.05e-3, rel=0.02)

    with_driver(use)


def test_a_drift_of_the_source_is_followed() -> None:
    async def use(bench: Bench, driver: Keysight3458AAmmeter) -> None:
        feed = bench.world.sources["source"]
        bench.world.sources["source"] = replace(feed, errors=CurrentErrors(drift_per_h=1e-3, warm_up_s=0.0))
        first, *_, last = await driver.measure(100, nplc=100)
        assert last.value / first.value - 1 == pytest.approx(1e-3 * (last.at_s - first.at_s) / 3600, rel=1e-2)

    with_driver(use)


@pytest.mark.parametrize(("line", "reported"), [(b"DCV 1", r"1, 1 to FUNC\?"), (b"DCI 1E-2", r"6, 0.01 to FUNC\?")])
def test_somebody_who_sets_it_to_something_else_is_a_fault(line: bytes, reported: str) -> None:
    async def use(bench: Bench, driver: Keysight3458AAmmeter) -> None:
        bench.instrument.session().feed(line + b"\n")
        with pytest.raises(
            InstrumentFault, match=rf"its settings have changed; received {reported}, expected 6, 0.001"
        ):
            await driver.measure(1, nplc=None)

    with_driver(use)


def test_set_to_volts_it_finds_no_current() -> None:
    async def use(bench: Bench, _driver: Keysight3458AAmmeter) -> None:
        bench.instrument.execute("DCV 1")
        bench.instrument.begin_reading()
        await asyncio.sleep(0.5)
        assert float(bench.instrument.end_reading()) == 0

    with_driver(use)

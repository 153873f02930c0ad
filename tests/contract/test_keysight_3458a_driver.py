"""The driver of the Keysight 3458A against the simulated one, in virtual time."""

import asyncio
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.capabilities import Voltmeter
from drivers.description import known_drivers
from drivers.dialects.keysight_3458a.description import DESCRIPTION, VoltmeterOptions, VoltmeterUncertainty
from drivers.dialects.keysight_3458a.driver import Keysight3458A
from drivers.errors import BadAnswer, BeyondLimit, Refused, WrongIdentity
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.meters.keysight_3458a import Simulated3458A
from simulators.instruments.meters.meter_inputs import VoltsOnLoad
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.world import World, WorldSettings
from tests.support.capabilities import CAPABILITIES
from tests.support.laboratory import STILL_AIR, place, unit
from tests.support.planar import planar
from tests.support.voltmeter import CYCLE_S, LOAD_OHM, Meter, now_s, with_driver, with_meter

SET_UP = b"PRESET NORM;TARM HOLD;TRIG AUTO;INBUF ON;END ALWAYS;QFORMAT NORM;DCV 1;NPLC 10;AZERO ON;TARM?\n"
STATE = [b"TARM?\n", b"FUNC?\n", b"NPLC?\n", b"AZERO?\n", b"MATH?\n", b"INBUF?\n"]

# The bench file and connecting


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["keysight_3458a"] is DESCRIPTION
    assert CAPABILITIES["voltmeter"] is Voltmeter
    options = VoltmeterOptions.model_validate({"range": "100 mV"})
    assert (options.range, options.nplc) == (0.1, 10)
    assert DESCRIPTION.channels_of(options) == {"voltage": "V"}
    assert VoltmeterUncertainty.model_validate({"gain": "8 ppm"}).gain == pytest.approx(8e-6)


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ({"range": "2 V"}, "is 2 V, expected 100 mV, 1 V, 10 V, 100 V or 1000 V"),
        ({"range": "1 A"}, "expected a quantity in V"),
        ({"range": "1 V", "nplc": 0.5}, "is 0.5, expected a whole number from 1 to 10, or 20 to 100 in tens"),
        ({"range": "1 V", "nplc": 15}, "is 15, expected"),
        ({"range": "1 V", "nplc": 200}, "is 200, expected"),
        ({"range": "1 V", "nplc": "10"}, "a number"),
        ({}, "missing"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        VoltmeterOptions.model_validate(data)


def test_it_is_held_identified_and_set_up_before_anything_else() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        assert isinstance(driver, Voltmeter)
        assert meter.wire.requests == [
            b"TARM HOLD;END ALWAYS;ID?\n", b"ERRSTR?\n", b"LFREQ?\n", SET_UP, b"ERRSTR?\n", *STATE,
        ]  # fmt: skip

    with_driver(use)


def test_every_line_asks_for_one_answer() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        await driver.identify()
        await driver.measure(2, nplc=1)
        await driver.poll()
        assert all(request.count(b"?") == 1 or request == b"TARM SGL\n" for request in meter.wire.requests)

    with_driver(use)


def test_it_identifies_itself_as_far_as_the_wire_tells() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        identity = await driver.identify()
        assert (identity.maker, identity.model, identity.firmware) == ("HP", "3458A", "9,2")
        assert (identity.serial, identity.verified) == ("US28031234", False)
        assert identity.fingerprint == "calibrated 12 times"
        assert await driver.identify() == identity

    with_driver(use)


def test_another_calibration_count_is_another_instrument() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        await driver.identify()
        meter.wire.alter = lambda request, answer: b"3\r\n" if request == b"CALNUM?\n" else answer
        with pytest.raises(WrongIdentity, match=r"has taken its place.*calibrated 3 times"):
            await driver.identify()

    with_driver(use)


@pytest.mark.parametrize(("pin", "problem"), [({"maker": "Keysight"}, "maker is 'HP'"), ({"model": "3457A"}, "model")])
def test_another_instrument_than_the_bench_files_is_refused(pin: dict[str, str], problem: str) -> None:
    async def use(meter: Meter) -> None:
        with pytest.raises(WrongIdentity, match=problem):
            await meter.driver(pin=pin).__aenter__()
        assert not [request for request in meter.wire.requests if b"DCV" in request]

    with_meter(use)


def test_another_firmware_is_refused_when_it_is_asked_for() -> None:
    async def use(meter: Meter) -> None:
        async with meter.driver(pin={"firmware": "9,1"}) as driver:
            with pytest.raises(WrongIdentity, match="firmware is '9,2', the bench file says '9,1'"):
                await driver.identify()

    with_meter(use)


def test_what_is_no_3458a_is_told_so() -> None:
    async def use(meter: Meter) -> None:
        with pytest.raises(BadAnswer, match=r"not a 3458A.*HP3457A"):
            await meter.driver().__aenter__()

    with_meter(use, identity="HP3457A")


# Measuring


def test_readings_come_one_after_the_other_with_the_time_of_their_middle() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.wire.requests.clear()
        began_s = now_s()
        readings = await driver.measure(5, nplc=None)
        assert meter.wire.requests == [*STATE, *[b"TARM SGL\n"] * 5, b"ERRSTR?\n"]
        assert [reading.value for reading in readings] == pytest.approx([0.5] * 5)
        middles = [began_s + 10 * CYCLE_S * (2 * number + 0.5) for number in range(5)]
        assert [reading.at_s for reading in readings] == pytest.approx(middles, abs=0.02)
        assert now_s() - began_s == pytest.approx(2.0, abs=0.03)

    with_driver(use)


@pytest.mark.parametrize("line_hz", [50.0, 60.0])
@pytest.mark.parametrize("nplc", [1, 7, 10, 100])
def test_line_cycles_are_set_for_a_measurement(nplc: float, line_hz: float) -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.wire.requests.clear()
        await driver.measure(1, nplc=nplc)
        began_s = now_s()
        await driver.measure(1, nplc=nplc)
        assert now_s() - began_s == pytest.approx(2 * nplc / line_hz, abs=0.03)
        assert meter.wire.count(b"PRESET") == (0 if nplc == 10 else 1)
        await driver.measure(1, nplc=None)
        assert meter.instrument.nplc == 10

    with_driver(use, line_hz=line_hz)


@pytest.mark.parametrize("nplc", [0, 0.5, 11, 200, float("nan")])
def test_line_cycles_that_do_not_reject_the_mains_are_refused_before_anything_is_sent(nplc: float) -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        sent = len(meter.wire.requests)
        with pytest.raises(BeyondLimit, match=r"line cycles are not 1 to 10, or 20 to 100 in tens\. Nothing was sent"):
            await driver.measure(1, nplc=nplc)
        assert len(meter.wire.requests) == sent

    with_driver(use)


def test_a_reading_follows_the_unit() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.world.move(60.0, 1000.0)
        await asyncio.sleep(5)
        (reading,) = await driver.measure(1, nplc=10)
        assert reading.value == pytest.approx(0.25, abs=1e-6)
        meter.world.power("supply", False)
        (reading,) = await driver.measure(1, nplc=10)
        assert reading.value == 0

    with_driver(use)


def test_a_poll_takes_one_reading() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        (reading,) = (await driver.poll())["voltage"]
        assert reading.value == pytest.approx(0.5)
        assert reading.at_s == pytest.approx(now_s() - 0.3, abs=0.01)
        assert len((await driver.poll())["voltage"]) == 1

    with_driver(use)


def test_a_poll_during_a_measurement_gives_what_it_has_read_so_far() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        measuring = asyncio.create_task(driver.measure(10, nplc=10))
        await asyncio.sleep(1.3)
        sent, began_s = len(meter.wire.requests), now_s()
        first = (await driver.poll())["voltage"]
        assert (len(meter.wire.requests), now_s(), len(first)) == (sent, began_s, 3)
        assert (await driver.poll())["voltage"] == []
        readings = await measuring
        assert [*first, *(await driver.poll())["voltage"]][:10] == readings

    with_driver(use)


def test_measurements_queue() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        readings = await asyncio.gather(driver.measure(3, nplc=1), driver.measure(2, nplc=2))
        assert [len(each) for each in readings] == [3, 2]
        assert readings[0][-1].at_s < readings[1][0].at_s

    with_driver(use)


def test_a_setting_that_the_instrument_does_not_know_is_refused_in_its_words() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.instrument.errors.add(106)
        with pytest.raises(Refused, match=r'not executed; sent PRESET.*received 106,"PARAMETER OUT OF RANGE"'):
            await driver.measure(1, nplc=5)
        assert (await driver.measure(1, nplc=5))[0].value == pytest.approx(0.5)

    with_driver(use)


def test_a_setting_whose_answer_is_lost_is_sent_once_and_decided_by_the_read_back() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.wire.mute(b"PRESET")
        assert (await driver.measure(1, nplc=5))[0].value == pytest.approx(0.5)
        assert meter.wire.count(b"NPLC 5") == 1

    with_driver(use)


def test_a_setting_that_is_lost_is_refused_and_not_repeated() -> None:
    async def use(meter: Meter, driver: Keysight3458A) -> None:
        meter.wire.lose = lambda request: b"PRESET" in request
        with pytest.raises(Refused, match=r"received 10 to NPLC\?, expected 5"):
            await driver.measure(1, nplc=5)
        assert meter.wire.count(b"NPLC 5") == 1

    with_driver(use)


def test_between_readings_the_bias_of_the_unit_wanders_on() -> None:
    now = [0.0]
    wandering = unit(accelerometer={"noise": {"instability": "1 mg"}})
    settings = WorldSettings(
        seed=1, gravity_mps2=9.8, fixture=planar(1, 90.0), chamber=STILL_AIR, places={"a": place(unit=wandering)}
    )
    world = World(settings, lambda: now[0])
    world.power("supply", True)
    on_load = VoltsOnLoad(world, VoltmeterSettings("a", LOAD_OHM), "voltmeter")
    meter, read = Simulated3458A(world, FaultPlan(now_s=lambda: now[0]), on_load), []
    for _ in range(300):
        now[0] += meter.begin_reading()
        read.append(float(meter.end_reading()))
        now[0] += 30.0
    assert np.std(read) == pytest.approx(1e-3 * 0.5, rel=0.2)
    assert abs(np.corrcoef(read[:-1], read[1:])[0, 1]) < 0.2, "it forgets in 10 s"

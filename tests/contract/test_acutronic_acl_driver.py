"""The driver of the Acutrol3000 against the simulated one, in virtual time: what it does when all is well."""

import asyncio
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.capabilities import Approach, Positioner, RateTable
from drivers.description import IdentityPin, known_drivers
from drivers.dialects.acutronic_acl.axis import AcutronicAcl
from drivers.dialects.acutronic_acl.description import DESCRIPTION, AclOptions
from drivers.errors import BadAnswer, BeyondLimit, CannotConnect, NotSettled, Refused, WrongIdentity
from drivers.kinds.axes import AxisUncertainty
from drivers.kinds.table.description import TableLimits
from tests.support.capabilities import CAPABILITIES
from tests.support.table import LIMITS, OPTIONS, WITH_ENDS, Table, framed, now_s, with_driver, with_table

# The bench file


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["acutronic_acl"] is DESCRIPTION
    assert DESCRIPTION.capabilities == {"positioner", "rate_table"} <= CAPABILITIES.keys()
    options = AclOptions.model_validate(OPTIONS)
    assert DESCRIPTION.channels_of(options) == {"angle": "°", "rate": "°/s"}
    assert (options.axis, options.rate_band, options.approach_distance, options.poll) == (1, 0.01, 2, 0.1)
    assert (options.byte_order, options.settle.give_up) == ("little", 30)
    certificate = {"zero": "10 arcsec", "harmonics": ["2 arcsec", "1 arcsec"], "repeatability": "0.2 arcsec"}
    assert AxisUncertainty.model_validate(certificate).harmonics == (2.0, 1.0)


@pytest.mark.parametrize(
    ("model", "data", "problem"),
    [
        (AclOptions, OPTIONS | {"axis": 0}, "greater than or equal to 1|at least 1"),
        (AclOptions, OPTIONS | {"acceleration": "200 °/s"}, "°/s²"),
        (AclOptions, OPTIONS | {"byte_order": "middle"}, "expected 'little' or 'big'"),
        (
            TableLimits,
            LIMITS | {"angle": {"min": "0°", "max": "360°"}},
            "leave limits.angle out for an axis without ends",
        ),
        (TableLimits, LIMITS | {"angle": {"min": "5°", "max": "-5°"}}, "min is not below max"),
        (TableLimits, {"rate": LIMITS["rate"], "acceleration": LIMITS["acceleration"]}, "missing"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(model: Any, data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        model.model_validate(data)


# Connecting


def test_looking_at_it_changes_nothing() -> None:
    async def use(table: Table) -> None:
        async with table.driver() as driver:
            assert isinstance(driver, Positioner)
            assert isinstance(driver, RateTable)
            assert (await driver.poll()).keys() == {"angle", "rate"}
            assert ((await driver.angle()).value, (await driver.rate()).value) == (0, 0)
        assert table.commands() == []

    with_table(use)


def test_it_identifies_itself_and_does_not_claim_a_serial_number_that_it_is_not_told() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Acutronic R&D USA", "Acutrol3000", "")
        assert not identity.verified
        assert identity.fingerprint == "Acutronic R&D USA,Acutrol3000,0,A8800-SIM"

    with_driver(use)


def test_a_serial_number_that_is_told_must_be_the_one_of_the_bench_file() -> None:
    async def use(table: Table) -> None:
        async with table.driver(IdentityPin(serial="A-17")) as driver:
            assert (await driver.identify()).verified
        with pytest.raises(WrongIdentity, match="serial is 'A-17', the bench file says 'A-18'"):
            await table.driver(IdentityPin(serial="A-18")).__aenter__()

    with_table(use, serial="A-17")


def test_another_controller_in_its_place_is_refused() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        table.wire.alter = lambda _request, answer: answer.replace(b"A8800", b"A8801")
        with pytest.raises(WrongIdentity, match=r"another instrument has taken its place; received .*A8801-SIM"):
            await driver.identify()

    with_driver(use)


@pytest.mark.parametrize("answer", [b"hello, who is there?\n", framed(b"KEITHLEY,MODEL 6220,1,A03"), framed(b"", 5)])
def test_what_is_no_acutrol_is_not_connected(answer: bytes) -> None:
    async def use(table: Table) -> None:
        table.wire.alter = lambda _request, _answer: answer
        with pytest.raises(BadAnswer, match=r"sent '\*IDN\?'"):
            await table.driver().__aenter__()

    with_table(use)


def test_the_byte_order_is_an_option() -> None:
    async def use(table: Table) -> None:
        with pytest.raises(BadAnswer, match="is byte_order of the bench file right"):
            await table.driver().__aenter__()
        async with table.driver(byte_order="big") as driver:
            assert (await driver.angle()).value == 0

    with_table(use, byte_order="big")


def test_nobody_there() -> None:
    async def use(table: Table) -> None:
        table.wire.broken = True
        with pytest.raises(CannotConnect):
            await table.driver().__aenter__()

    with_table(use)


# Taking control


def test_the_first_motion_takes_control_and_energises_step_by_step() -> None:
    async def use(table: Table) -> None:
        heard_at_s: dict[str, float] = {}

        def note(request: bytes) -> bool:
            heard_at_s.setdefault(request.decode().strip(), now_s())
            return False

        table.wire.lose = note
        async with table.driver() as driver:
            await driver.rotate_at(10, acceleration_dps2=None)
            assert table.commands() == [
                ":UTIL:LOCKOUT ON", ":UTIL:REMOTELOCKOUT ON", ":MODE:OFF 1", ":INTERLOCK:CLOSE 1",
                ":LIM:RATE R,1,400", ":LIM:ACC R,1,200", ":LIM:RATE O,1,400", ":LIM:ACC O,1,200",
                ":DEM:RATE 1,0", ":MODE:RATE 1", ":DEM:RATE 1,10",
            ]  # fmt: skip
            assert heard_at_s[":INTERLOCK:CLOSE 1"] - heard_at_s[":MODE:OFF 1"] >= 0.25
            assert heard_at_s[":LIM:RATE R,1,400"] - heard_at_s[":INTERLOCK:CLOSE 1"] >= 0.25
            assert heard_at_s[":MODE:RATE 1"] - heard_at_s[":LIM:ACC O,1,200"] >= 0.5
            assert table.controller.at_panel(":MODE:OFF 1").code != 0
            sent = len(table.commands())
            await driver.rotate_at(20, acceleration_dps2=None)
            assert [line for line in table.commands()[sent:] if not line.startswith(":LIM")] == [":DEM:RATE 1,20"]
            await driver.stop()
        assert table.commands()[-2:] == [":UTIL:LOCKOUT OFF", ":UTIL:REMOTELOCKOUT OFF"]
        assert table.controller.at_panel(":MODE:OFF 1").code == 0

    with_table(use)


# Going to angles


def test_a_move_goes_settles_and_reads_back() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        start_s = now_s()
        reading = await driver.move_to(100, approach="direct", settle_s=3)
        assert reading.value == table.angle_deg == 100
        taking_control_s, travel_s, hold_s = 1.0, 1 + 0.5, 1.0
        assert now_s() - start_s == pytest.approx(taking_control_s + travel_s + hold_s + 3, abs=0.3)
        assert table.commands(":DEM:POS") == [":DEM:POS 1,0", ":DEM:POS 1,100"]
        assert (await driver.poll())["angle"][0].value == 100

    with_driver(use)


@pytest.mark.parametrize(
    ("start_deg", "approach", "demands"),
    [
        (0, "from_below", ["30"]),
        (0, "from_above", ["32", "30"]),
        (30, "from_below", ["28", "30"]),
        (30, "from_above", ["32", "30"]),
        (60, "from_below", ["28", "30"]),
        (60, "from_above", ["30"]),
        (30, "direct", ["30"]),
    ],
)
def test_every_visit_is_approached_from_its_side(start_deg: float, approach: Approach, demands: list[str]) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.move_to(start_deg, approach="direct", settle_s=0)
        before = len(table.commands(":DEM:POS"))
        assert (await driver.move_to(30, approach=approach, settle_s=0)).value == 30
        assert [line.split(",")[1] for line in table.commands(":DEM:POS")[before:]] == demands

    with_driver(use)


def test_a_long_way_is_gone_as_the_angle_says_and_not_the_shorter_way() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        assert (await driver.move_to(270, approach="direct", settle_s=0)).value == 270
        assert table.commands(":DEM:POS")[1:] == [":DEM:POS 1,90", ":DEM:POS 1,180", ":DEM:POS 1,270"]
        assert table.angle_deg == pytest.approx(270)
        assert (await driver.move_to(-30, approach="direct", settle_s=0)).value == -30
        assert table.angle_deg == pytest.approx(-30)
        assert table.commands(":DEM:POS")[-1] == ":DEM:POS 1,330"

    with_driver(use)


def test_an_axis_with_ends_goes_from_one_to_the_other_between_them() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.move_to(-170, approach="direct", settle_s=0)
        assert (await driver.move_to(170, approach="direct", settle_s=0)).value == 170
        assert table.angle_deg == pytest.approx(170)
        assert table.commands(":DEM:POS")[-3:] == [":DEM:POS 1,-56.666667", ":DEM:POS 1,56.666667", ":DEM:POS 1,170"]
        sent = len(table.wire.requests)
        for angle_deg, approach in ((170.001, "direct"), (-169, "from_below")):
            with pytest.raises(BeyondLimit, match="is outside -170° to 170°"):
                await driver.move_to(angle_deg, approach=approach, settle_s=0)
        with pytest.raises(BeyondLimit, match="cannot rotate continuously"):
            await driver.rotate_at(1, acceleration_dps2=None)
        assert len(table.wire.requests) == sent
        with pytest.raises(BeyondLimit, match="the end of the swing 171° is outside"):
            await driver.oscillate(1, 1)
        assert not table.commands(":MODE:SYNTHESIS")

    with_driver(use, WITH_ENDS)


def test_angles_begin_in_the_turn_that_the_ends_lie_in() -> None:
    async def use(table: Table) -> None:
        table.demand_elsewhere(":INTERLOCK:CLOSE 1", ":DEM:POS 1,-60", ":MODE:POSITION 1")
        await asyncio.sleep(5)
        async with table.driver() as driver:
            assert (await driver.angle()).value == 300
        table.limits = LIMITS
        async with table.driver() as driver:
            assert (await driver.angle()).value == -60

    with_table(use, LIMITS | {"angle": {"min": "10°", "max": "350°"}})


def test_a_table_that_is_moved_while_it_settles_is_not_settled() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        asyncio.get_running_loop().call_later(8.0, table.demand_elsewhere, ":DEM:POS 1,10.01")
        with pytest.raises(NotSettled, match=r"left 10° within 10 s; received 10\.01000°, 0\.00000 °/s, mode Position"):
            await driver.move_to(10, approach="direct", settle_s=10)

    with_driver(use)


# Turning


@pytest.mark.parametrize(
    ("rate_dps", "acceleration_dps2"), [(90, None), (-90, None), (400, 100), (0.005, None), (0, 5)]
)
def test_it_turns_at_the_rate_it_is_told(rate_dps: float, acceleration_dps2: float | None) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(1, acceleration_dps2=None)
        start_s = now_s()
        await driver.rotate_at(rate_dps, acceleration_dps2=acceleration_dps2)
        assert table.rate_dps == pytest.approx(rate_dps, rel=1e-3, abs=0.01)
        assert now_s() - start_s == pytest.approx(abs(rate_dps - 1) / (acceleration_dps2 or 200), abs=0.15)
        assert (await driver.rate()).value == pytest.approx(rate_dps, rel=1e-3, abs=0.01)
        await asyncio.sleep(1)
        readings = await driver.poll()
        assert readings["rate"][0].value == pytest.approx(rate_dps, abs=1e-5)

    with_driver(use)


@pytest.mark.parametrize(
    ("rate_dps", "acceleration_dps2", "problem"),
    [
        (401, None, "the rate of 401 °/s is not between 0 and 400 °/s"),
        (-401, None, "the rate of 401 °/s is not"),
        (math.nan, None, "the rate of nan °/s is not"),
        (10, 4201, "the acceleration of 4201 °/s² is not between 0 and 4200 °/s²"),
        (10, 0, "the acceleration of 0 °/s² is not"),
    ],
)
def test_beyond_its_limits_it_does_not_turn(rate_dps: float, acceleration_dps2: float | None, problem: str) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        sent = len(table.wire.requests)
        with pytest.raises(BeyondLimit, match=f"{problem}.*Nothing was moved"):
            await driver.rotate_at(rate_dps, acceleration_dps2=acceleration_dps2)
        assert len(table.wire.requests) == sent

    with_driver(use)


@pytest.mark.parametrize("rate_dps", [30, -400])
@pytest.mark.parametrize("look_every_s", [0.37, 10])
def test_angles_count_whole_turns(rate_dps: float, look_every_s: float) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(rate_dps, acceleration_dps2=None)
        for _ in range(int(40 / look_every_s)):
            await asyncio.sleep(look_every_s)
            assert (await driver.angle()).value == pytest.approx(table.angle_deg, abs=1)
        await driver.stop()
        assert (await driver.angle()).value == pytest.approx(table.angle_deg, abs=1e-4)
        home_deg = 360 * round(table.angle_deg / 360)
        assert (await driver.move_to(home_deg, approach="direct", settle_s=0)).value == pytest.approx(
            home_deg, abs=1e-4
        )
        assert table.angle_deg == pytest.approx(home_deg, abs=1e-4)

    with_driver(use)


def test_it_changes_its_mode_at_rest_only() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(200, acceleration_dps2=None)
        rates_dps: list[float] = []

        def note(request: bytes) -> bool:
            if request.startswith(b":MODE:") and not request.startswith(b":MODE:OFF"):
                rates_dps.append(table.rate_dps)
            return False

        table.wire.lose = note
        where_deg = table.angle_deg
        await driver.move_to(where_deg + 90, approach="direct", settle_s=0)
        await driver.oscillate(0.5, 5)
        await driver.rotate_at(-200, acceleration_dps2=None)
        assert rates_dps == [0, 0, 0]

    with_driver(use)


# Swinging


@pytest.mark.parametrize(("amplitude_deg", "frequency_hz"), [(10, 0.5), (1, 2), (0.0047, 25), (170, 0.1)])
def test_it_swings_as_it_is_told_about_where_it_stood(amplitude_deg: float, frequency_hz: float) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.move_to(40, approach="direct", settle_s=0)
        await driver.oscillate(amplitude_deg, frequency_hz)
        times_s = table.world.now() + np.linspace(0, 1 / frequency_hz, 257)[:-1]
        phasor = np.exp(-2j * math.pi * frequency_hz * times_s)
        swing_deg = table.world.axis.true_deg(times_s)
        assert 2 * abs((phasor * swing_deg).mean()) == pytest.approx(amplitude_deg, rel=1e-5)
        assert swing_deg.mean() == pytest.approx(40, abs=1e-6)
        await asyncio.sleep(13.7)
        readings = await driver.poll()
        assert readings["angle"][0].value == pytest.approx(
            table.angle_deg, abs=0.02 + 7 * frequency_hz * amplitude_deg * 0.002
        )
        assert abs(readings["angle"][0].value - 40) <= amplitude_deg * 1.0001
        await driver.stop()
        assert not table.moving
        assert (await driver.angle()).value == pytest.approx(table.angle_deg, abs=1e-4)

    with_driver(use)


def test_while_it_grows_a_sine_keeps_near_its_limits() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        amplitude_deg, frequency_hz = 20.0, 1.0  # 126 °/s and 790 °/s² at most
        start_s = table.world.now()
        await driver.oscillate(amplitude_deg, frequency_hz)
        times_s, step_s = np.linspace(start_s + 0.6, table.world.now() + 1, 40_001, retstep=True)
        swing_deg = table.world.axis.true_deg(times_s)
        assert np.abs(np.gradient(swing_deg, step_s)).max() < 1.01 * 2 * math.pi * frequency_hz * amplitude_deg

    with_driver(use)


@pytest.mark.parametrize(
    ("amplitude_deg", "frequency_hz", "problem"),
    [
        (1, 26, "the frequency of 26 Hz is not between 0 and 25 Hz"),
        (64, 1, r"the sine's peak rate of 402\.124 °/s is not between 0 and 400 °/s"),
        (0.5, 15, r"the sine's peak acceleration of 4441\.32 °/s² is not between 0 and 4200 °/s²"),
        (171, 0.01, "the amplitude of 171 ° is not between 0 and 170 °"),
        (0, 1, "the amplitude of 0 °"),
        (1, 0, "the frequency of 0 Hz"),
    ],
)
def test_a_sine_beyond_the_limits_is_refused_before_anything_is_sent(
    amplitude_deg: float, frequency_hz: float, problem: str
) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        sent = len(table.wire.requests)
        with pytest.raises(BeyondLimit, match=problem):
            await driver.oscillate(amplitude_deg, frequency_hz)
        assert len(table.wire.requests) == sent

    with_driver(use)


def test_one_sine_after_another_stops_between() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.oscillate(5, 1)
        await driver.oscillate(2, 2)
        assert table.commands(":MODE:")[-3:] == [":MODE:OFF 1", ":MODE:POSITION 1", ":MODE:SYNTHESIS 1"]
        assert table.commands(":DEM:OSC") == [":DEM:OSC 1,5,1,0", ":DEM:OSC 1,2,2,0"]
        assert table.commands(":CONFIG") == [
            ":CONFIG:OSC 1,Enable,1.25,0.25,Pos,Lin",
            ":CONFIG:OSC 1,Enable,1,1,Pos,Lin",
        ]

    with_driver(use)


def test_it_sweeps_the_frequency_of_a_running_sine() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.move_to(40, approach="direct", settle_s=0)
        await driver.oscillate(0.5, 2)
        begin_s = table.world.now()
        await driver.sweep(12, 20)
        assert table.commands(":CONFIG")[-1] == ":CONFIG:OSC 1,Enable,0.5,0.5,Pos,Lin"
        assert table.commands(":DEM:OSC")[-1] == ":DEM:OSC 1,0.5,12,0"
        assert table.commands(":MODE:")[-1] == ":MODE:SYNTHESIS 1"  # without a stop between
        await asyncio.sleep(8)
        await driver.poll()  # which finds no deviation while the frequency changes
        times_s = np.linspace(table.world.now() - 5, table.world.now(), 20_001)
        middle_s = times_s.mean() - begin_s
        crossings = np.flatnonzero(np.diff(table.world.axis.true_deg(times_s) > 40))
        assert len(crossings) / 2 / 5 == pytest.approx(2 + middle_s * 0.5, abs=0.4)
        await asyncio.sleep(15)
        await driver.poll()
        times_s = table.world.now() + np.linspace(0, 1, 4097)[:-1]
        assert 2 * abs((np.exp(-24j * math.pi * times_s) * table.world.axis.true_deg(times_s)).mean()) == pytest.approx(
            0.5, rel=1e-5
        )
        await driver.stop()
        assert not table.moving

    with_driver(use)


def test_only_a_running_sine_is_swept_and_within_the_limits() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        with pytest.raises(Refused, match="there is no oscillation whose frequency could be swept"):
            await driver.sweep(12, 20)
        await driver.oscillate(0.5, 2)
        sent = len(table.wire.requests)
        with pytest.raises(BeyondLimit, match="the frequency of 26 Hz is not between 0 and 25 Hz"):
            await driver.sweep(26, 20)
        with pytest.raises(BeyondLimit, match="the sine's peak acceleration"):
            await driver.sweep(20, 20)
        assert len(table.wire.requests) == sent
        await driver.stop()
        with pytest.raises(Refused, match="there is no oscillation"):
            await driver.sweep(12, 20)

    with_driver(use)


def test_a_sweep_that_does_not_begin_is_told() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.oscillate(0.5, 2)
        table.faults.begin("stuck")
        with pytest.raises(NotSettled, match="the sweep from 2 to 12 Hz has not begun"):
            await driver.sweep(12, 20)

    with_driver(use)


# Stopping


def test_a_stop_leaves_the_drive_on_and_the_table_at_rest() -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        await driver.rotate_at(400, acceleration_dps2=None)
        start_s = now_s()
        await driver.stop()
        assert not table.moving
        assert now_s() - start_s == pytest.approx(2.0, abs=0.15)
        assert table.controller.interlock.value == "Close"
        await driver.poll()
        await driver.rotate_at(10, acceleration_dps2=None)

    with_driver(use)


@pytest.mark.parametrize("motion", ["move", "rotate", "oscillate"])
@pytest.mark.parametrize("ending", ["stop", "make_safe"])
def test_stopping_ends_the_motion_under_way(motion: str, ending: str) -> None:
    async def use(table: Table, driver: AcutronicAcl) -> None:
        motions = {
            "move": lambda: driver.move_to(300, approach="from_above", settle_s=0),
            "rotate": lambda: driver.rotate_at(300, acceleration_dps2=50),
            "oscillate": lambda: driver.oscillate(10, 1),
        }
        await driver.rotate_at(0, acceleration_dps2=None)
        task = asyncio.ensure_future(motions[motion]())
        await asyncio.sleep(1.55)
        assert table.moving
        await getattr(driver, ending)()
        assert not table.moving
        stood_deg = table.angle_deg
        with pytest.raises(Refused, match=r"ended by another command|aborted, the instrument"):
            await task
        await asyncio.sleep(10)
        assert table.angle_deg == stood_deg

    with_driver(use)

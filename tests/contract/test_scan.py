"""Every simulated instrument is found by its own driver and by no other, and is as it was before it was asked."""

import asyncio
from collections.abc import Sequence
from dataclasses import replace

import pytest

from bench.app.proposals import entries, pinned, proposal
from bench.app.scan import PLACE_LIMIT_S, AddressScan, recognising, scan
from bench.config.devices import DeviceEntry
from bench.config.document import parse_document
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import known_drivers
from drivers.discovery.questions import QueryPort
from drivers.discovery.recognition import IDN, SCPI, Found, Recognition
from drivers.transport.address import Address
from drivers.values import Identity
from simulators.instruments.scpi import Interpreter
from tests.support.lines import TappedWire
from tests.support.runs import ROOT
from tests.support.scanned import Case, cases, profile, simulated, standing, wire_to

ALL = cases()
every_case = pytest.mark.parametrize("case", ALL, ids=str)
CLOCKS = ("_ready_s", "_air_c", "_found", "_known")  # what time alone changes, and what was looked up


def scanned(
    case: Case, drivers: Sequence[str] = ()
) -> tuple[AddressScan, float, dict[str, tuple[str, str]], TappedWire]:
    """What a scan finds, how long it took, what it left changed in the instrument, and what passed."""
    outcome = []

    async def main() -> None:
        instrument = simulated(case)
        wire = wire_to(case, instrument)
        before, began_s = remembered(instrument), asyncio.get_running_loop().time()
        place = await scan(case.address, wire, recognising(drivers))
        took_s, after = asyncio.get_running_loop().time() - began_s, remembered(instrument)
        changed = {key: (before[key], after[key]) for key in before.keys() & after.keys() if before[key] != after[key]}
        outcome.append((place, took_s, changed, wire))

    run(main(), AS_FAST_AS_POSSIBLE)
    return outcome[0]


def remembered(instrument: object) -> dict[str, str]:
    return standing(instrument, lambda key: key.endswith(CLOCKS))


def test_the_shipped_drivers_whose_instruments_can_be_asked_take_part() -> None:
    assert len({case.driver for case in ALL}) >= 16


@every_case
def test_an_instrument_is_found_by_its_own_driver_alone_in_time_and_is_as_it_was(case: Case) -> None:
    place, took_s, changed, _ = scanned(case)
    assert [candidate.driver.name for candidate in place.candidates] == [case.driver]
    assert took_s < 20.0
    if case.driver == "keysight_3458a":
        assert changed.pop(".codes")[1].startswith("{'TARM': 4,")  # waits for a trigger, as its page says
    assert changed == {}
    (candidate,) = place.candidates
    for name, value in candidate.found.blocks.get("options", {}).items():
        assert case.options.get(name, value) == value


@every_case
def test_no_other_driver_knows_it_even_when_it_is_the_first_to_ask(case: Case) -> None:
    async def main() -> None:
        instrument = simulated(case)
        for driver, recognition in recognising():
            if case.scheme in driver.schemes and not recognition.generic and driver.name != case.driver:
                async with QueryPort(wire_to(case, instrument), case.address, 1) as port:
                    with pytest.raises(ValueError, match=r".*"):
                        await recognition.recognise(port)

    run(main(), AS_FAST_AS_POSSIBLE)


@every_case
def test_what_is_proposed_is_an_entry_that_a_check_accepts(case: Case) -> None:
    place, *_ = scanned(case)
    text = proposal([place])
    if case.driver == "modbus_chamber":
        assert "write its profile first" in text
        assert entries([place]) == {}
        text = "\n".join(line.replace("  # ", "  ", 1) for line in text.splitlines() if not line.endswith("first:"))
    devices = parse_document(text, ROOT / "found.yaml").value["devices"]
    context = {"folder": ROOT, "files_needed": False, "load": lambda _path, _model: profile()}
    (device,) = devices.values()
    entry = DeviceEntry.model_validate(device, context=context)
    assert entry.driver == case.driver
    assert entry.connection.scheme == case.scheme
    assert entry.identity.model_dump(exclude_none=True) == pinned(place.candidates[0].found.identity)


@pytest.mark.parametrize("case", [case for case in ALL if case.address.is_serial_line], ids=str)
def test_half_a_message_on_a_line_does_not_hide_an_instrument(case: Case) -> None:
    async def main() -> AddressScan:
        instrument = simulated(case)
        wire = wire_to(case, instrument)
        wire.instrument.session().feed(b"\xf8\x80*I\xfe")  # as *IDN? looks at another baud rate
        settings = {"baud": "9600"}  # given, so that there is no second try by another setting
        return await scan(replace(case.address, options=settings), wire, recognising())

    assert [candidate.driver.name for candidate in run(main(), AS_FAST_AS_POSSIBLE).candidates] == [case.driver]


# What scans must not do, and what they say


class Answering:
    """A port on which everything is answered alike."""

    unit_id, is_serial_line = 1, False

    def __init__(self, answer: bytes) -> None:
        self._answer = answer

    async def query(self, question: bytes, *, again: bool = False) -> bytes:
        return self._answer

    async def registers(self, address: int, count: int, function: int = 3) -> list[int]:
        return list(self._answer[:count])


@pytest.mark.parametrize(
    "answer",
    [
        b"", b"\r\n",
        b"\x00" * 40, b"\xff" * 40, b"?" * 60, b"0\n", b"OK\r\n", b"%\n", b"1,2,3,4\n", b"\x1b[31m,a,b,c\n",
        b"ACME,DMM 1,0,\x07\n", b"0,Firmware,EndOfAPI", b"ERROR\r\n", b"-113,\"Undefined header\"\n", b"NA:CMD ERR\r\n",
    ],
)  # fmt: skip
def test_no_driver_takes_nonsense_for_its_instrument(answer: bytes) -> None:
    async def main() -> list[str]:
        claims = []
        for driver, recognition in recognising():
            try:
                await recognition.recognise(Answering(answer))
            except ValueError:
                continue
            claims.append(driver.name)
        return claims

    claims = run(main(), AS_FAST_AS_POSSIBLE)
    assert set(claims) <= {"modbus_chamber"}  # the fake has registers


def test_a_generic_question_leaves_no_error_in_an_instrument_that_does_not_know_it() -> None:
    place, _, changed, wire = scanned(Case("agilent_34970a", "tcp"), ["scpi_supply"])
    assert place.candidates == ()
    assert place.words.startswith(
        r"an instrument answers that no driver recognises: sent '*IDN?\r\n', received "
        r"'HEWLETT-PACKARD"
    )
    assert wire.count(b":VOLT?") == 1
    assert {key for key in changed if "_errors" in key} == set()


@pytest.mark.parametrize("known", [(), ("STATus:ERRor?",), ("SYSTem:ERRor[:NEXT]?",)])
def test_a_supply_is_known_whatever_it_is_asked_for_its_errors_by(known: tuple[str, ...]) -> None:
    reported = dict.fromkeys(("VOLTage?", "CURRent?", "OUTPut?"), lambda _: "0")
    interpreter = Interpreter("ACME,PSU 1,,1.0", reported, error_queries=known)

    class Supply(Answering):
        async def query(self, question: bytes, *, again: bool = False) -> bytes:
            return interpreter.execute(question.decode().strip()).encode()

    async def main() -> Found:
        return await known_drivers()["scpi_supply"].recognised_by().recognise(Supply(b""))

    found = run(main(), AS_FAST_AS_POSSIBLE)
    assert (found.identity.maker, found.identity.model) == ("ACME", "PSU 1")


def test_nobody_there_is_told_within_the_time_for_a_place() -> None:
    async def main() -> None:
        instrument = simulated(Case("cts", "serial"))
        wire = TappedWire(instrument)
        wire.lose = lambda _data: True
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        place = await scan(Address.parse("serial:///dev/ttyUSB0"), wire, recognising())
        assert loop.time() - began_s < 20.0 < PLACE_LIMIT_S
        assert place.words == "no answer"
        wire.broken = True
        place = await scan(Address.parse("tcp://127.0.0.1:1"), wire, recognising())
        assert place.words == "no connection to tcp://127.0.0.1:1"

    run(main(), AS_FAST_AS_POSSIBLE)


def test_somebody_who_never_stops_talking_does_not_hold_a_scan_up() -> None:
    async def main() -> None:
        wire = TappedWire(simulated(Case("cts", "serial")))

        async def talk() -> None:
            while True:
                await asyncio.sleep(0.05)
                for tap in wire.connections:
                    if tap.transport is not None and not tap.transport.is_closing():
                        tap.transport.write(b"25.0 C\r\n")

        talking = asyncio.create_task(talk())
        place = await scan(Address.parse("serial:///dev/ttyUSB0?baud=9600"), wire, recognising())
        talking.cancel()
        assert place.words == f"scan not finished within {PLACE_LIMIT_S:g} s"

    run(main(), AS_FAST_AS_POSSIBLE)


def test_several_units_on_one_line_are_all_found() -> None:
    async def main() -> None:
        case = Case("watlow_f4", "serial", {"unit_id": 3})
        place = await scan(case.address, wire_to(case, simulated(case)), recognising(), units=(1, 2, 3))
        assert entries([place])["chamber"]["options"] == {"unit_id": 3}

    run(main(), AS_FAST_AS_POSSIBLE)


def test_several_drivers_that_know_one_instrument_are_all_told(monkeypatch: pytest.MonkeyPatch) -> None:
    async def ask(port: object) -> Found:
        return Found(Identity(maker="A", model="on", serial='x"}: {\\', firmware="1.10"))

    async def main() -> None:
        case = Case("keithley_6220", "tcp")
        (first, known), *_ = recognising(["keithley_6220"])
        other = (known_drivers()["yokogawa_gs200"], Recognition(SCPI, ask, starter=known.starter))
        place = await scan(case.address, wire_to(case, simulated(case)), [(first, known), other])
        assert place.line() == (
            "tcp://127.0.0.1:4000: keithley_6220 (KEITHLEY INSTRUMENTS INC. MODEL 6220 SIM-6220-01 D04  /700x) "
            r'or yokogawa_gs200 (A on x"}: {\ 1.10)'
        )
        text = proposal([place])
        assert text.count("  # one of several drivers that recognise the instrument:\n") == 2
        assert r'identity: {maker: A, model: "on", serial: "x\"}: {\\", firmware: "1.10"}' in text
        assert entries([place]) == {}

    run(main(), AS_FAST_AS_POSSIBLE)


def test_the_same_question_is_sent_once_for_all_drivers_of_a_language() -> None:
    *_, wire = scanned(Case("scpi_supply", "tcp"))
    assert wire.count(IDN) == 1

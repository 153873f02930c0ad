"""Search for instruments: which drivers recognise the instrument at an address."""

from __future__ import annotations

import asyncio
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from bench.errors import InputError, InUseError
from bench.loop import REAL_TIME
from bench.loop import run as run_loop
from bench.runner.held import holding
from drivers.description import DriverDescription, known_drivers
from drivers.discovery.questions import QuestionPort
from drivers.discovery.recognition import Found, Language, Recognition
from drivers.errors import CannotConnect
from drivers.schema.suggest import did_you_mean
from drivers.transport.address import Address, AddressError
from drivers.transport.exchange import printable
from drivers.transport.serial import serial_ports
from drivers.transport.wires import RealWires, Wires

PLACE_LIMIT_S = 60.0
BETWEEN_CONNECTIONS_S = 0.2  # what an instrument that takes one connection needs to let go of the last one

Known = tuple[DriverDescription, Recognition]


@dataclass(frozen=True)
class Candidate:
    """An instrument that was found, and a driver that knows it."""

    address: Address
    unit_id: int
    driver: DriverDescription
    recognition: Recognition
    found: Found


@dataclass(frozen=True)
class Place:
    """What there is at an address: every driver that knows who answers, or in words why there is none."""

    address: Address
    candidates: tuple[Candidate, ...] = ()
    words: str = ""

    def line(self) -> str:
        """For a terminal."""
        told = [f"{each.driver.name} ({each.found.identity.words or 'gives no identity'})" for each in self.candidates]
        return f"{self.address}: {' or '.join(told) or self.words}"


def address_of(text: str) -> Address:
    """An address as in a bench file, `host:port`, or the path of a serial port; InputError."""
    spelled = text
    if text.startswith("/"):
        spelled = f"serial://{text}"
    elif "://" not in text and not text.startswith(("can:", "sim+")):
        spelled = f"tcp://{text}"
    try:
        address = Address.parse(spelled)
    except AddressError as problem:
        raise InputError(str(problem)) from None
    if address.simulated:
        raise InputError(
            f"{text}: a simulated address has nothing to scan; run bench simulate and scan the address without sim+"
        )
    return address


def recognising(names: Sequence[str] = ()) -> list[Known]:
    """The drivers of these names, or all, that know their instruments; InputError for a name that is none."""
    drivers = known_drivers()
    for name in names:
        if name not in drivers:
            raise InputError(f"there is no driver '{name}'{did_you_mean(name, drivers)}")
        if not drivers[name].recognition:
            raise InputError(
                f"the driver '{name}' cannot recognise its instrument by queries, so a scan cannot find it"
            )
    chosen = (drivers[name] for name in (names or sorted(drivers)))
    return [(driver, found) for driver in chosen if (found := driver.recognised_by()) is not None]


def scan_here(
    texts: Sequence[str], *, serial: bool | None = None, drivers: Sequence[str] = (), units: Sequence[int] = (1,),
    baud: int = 0,
) -> list[Place]:  # fmt: skip
    """Scans these addresses, and the serial ports of this machine when asked, or when no address is given. InputError.

    A place without a candidate says why in its words.
    """
    known, addresses = recognising(drivers), [address_of(text) for text in texts]
    if serial if serial is not None else not texts:
        given = {os.path.realpath(address.path) for address in addresses if address.path}
        ports = [port.path for port in serial_ports() if os.path.realpath(port.path) not in given]
        addresses += [address_of(port) for port in ports]

    async def look(address: Address) -> Place:
        try:
            with holding([address], "a scan"):
                return await scan(address, RealWires(), known, units=units, baud=baud)
        except InUseError as problem:
            return Place(address, words=str(problem))

    async def main() -> list[Place]:
        return await asyncio.gather(*(look(address) for address in addresses))

    return run_loop(main(), REAL_TIME)


async def scan(
    address: Address, wires: Wires, drivers: Sequence[Known], *, units: Sequence[int] = (1,), baud: int = 0
) -> Place:
    """Identify the instruments at an address; takes a minute at most."""
    usable = [known for known in drivers if address.scheme in known[0].schemes]
    if not usable:
        return Place(
            address, words="no driver that can recognise its instrument by queries uses this kind of connection"
        )
    look = _Look(address, wires, units)
    try:
        async with asyncio.timeout(PLACE_LIMIT_S):
            for at, tried in _settings(address, usable, baud):
                await look.at(at, tried)
                if look.candidates:
                    break
    except CannotConnect as problem:
        if not look.connected:
            return Place(address, words=problem.problem)
        look.words = f"accepted {look.connected} connections, then refused more"
    except TimeoutError:
        look.words = f"scan not finished within {PLACE_LIMIT_S:g} s"
    return Place(address, tuple(look.candidates), look.words or ("" if look.candidates else look.silence))


def _settings(address: Address, drivers: Sequence[Known], baud: int) -> Iterator[tuple[Address, list[Known]]]:
    """The address with every setting of its line that is worth trying, each with the drivers to try there."""
    if address.scheme != "serial" or address.options:
        yield address, list(drivers)
        return
    usual = Counter(line for _, known in drivers for line in known.lines)
    for line in [f"baud={baud}"] if baud else [line for line, _ in usual.most_common()]:
        options = dict(part.split("=") for part in line.split("&"))
        yield replace(address, options=options), [known for known in drivers if baud or line in known[1].lines]


class _Look:
    """Scan of one address: a connection for each protocol, until an instrument is recognised."""

    def __init__(self, address: Address, wires: Wires, units: Sequence[int]) -> None:
        self.candidates: list[Candidate] = []
        self.connected = 0
        self.words = ""
        self._heard: Mapping[bytes, bytes] = {}
        self._address, self._wires, self._units = address, wires, units

    @property
    def silence(self) -> str:
        """Why no instrument was recognised."""
        if not self._heard:
            return "no answer"
        question, answer = next(iter(self._heard.items()))
        return (
            f"an instrument answers that no driver recognises: sent {printable(question)}, received {printable(answer)}"
        )

    async def at(self, address: Address, drivers: Sequence[Known]) -> None:
        """Tries the languages of these drivers."""

        def language(known: Known) -> tuple[int, str]:
            return known[1].language.rank, known[1].language.name

        for _, group in groupby(sorted(drivers, key=language), key=language):
            speaking = list(group)
            for unit_id in self._numbers(speaking[0][1].language):
                await self._speak(address, speaking, unit_id)
            if self.candidates:
                return

    def _numbers(self, language: Language) -> Sequence[int]:
        return self._units if language.numbered else self._units[:1]

    async def _speak(self, address: Address, drivers: Sequence[Known], unit_id: int) -> None:
        """Asks in one language; the generic drivers only when no other one knows who answers."""
        if self.connected:
            await asyncio.sleep(BETWEEN_CONNECTIONS_S)
        async with QuestionPort(self._wires, address, unit_id) as port:
            self.connected += 1
            found = await _known_by([known for known in drivers if not known[1].generic], port, address)
            found = found or await _known_by([known for known in drivers if known[1].generic], port, address)
        self.candidates += found
        self._heard = self._heard or {question: answer for question, answer in port.said.items() if answer}


async def _known_by(drivers: Sequence[Known], port: QuestionPort, address: Address) -> list[Candidate]:
    candidates = []
    for driver, recognition in drivers:
        try:
            found = await recognition.ask(port)
        except ValueError:  # somebody else, or nobody
            continue
        candidates.append(Candidate(address, port.unit_id, driver, recognition, found))
    return candidates

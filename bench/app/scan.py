"""Search for instruments: identification of the drivers that recognise the instrument at an address."""

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
from bench.runner.held import address_lock
from drivers.description import DriverDescription, known_drivers
from drivers.discovery.questions import QueryPort
from drivers.discovery.recognition import Found, Language, Recognition
from drivers.errors import CannotConnect
from drivers.schema.suggest import did_you_mean
from drivers.transport.address import Address, AddressError
from drivers.transport.exchange import printable
from drivers.transport.serial import serial_ports
from drivers.transport.wires import RealWires, Wires

PLACE_LIMIT_S = 60.0
BETWEEN_CONNECTIONS_S = 0.2  # time for an instrument with a single connection to release the last one

Known = tuple[DriverDescription, Recognition]


@dataclass(frozen=True)
class Candidate:
    """Instrument that was found, and a driver that recognises it."""

    address: Address
    unit_id: int
    driver: DriverDescription
    recognition: Recognition
    found: Found


@dataclass(frozen=True)
class AddressScan:
    """Result for one address: drivers that recognise the instrument, or the reason why there is none."""

    address: Address
    candidates: tuple[Candidate, ...] = ()
    words: str = ""

    def line(self) -> str:
        """Line for a terminal."""
        drivers = [
            f"{each.driver.name} ({each.found.identity.words or 'gives no identity'})" for each in self.candidates
        ]
        return f"{self.address}: {' or '.join(drivers) or self.words}"


def address_of(text: str) -> Address:
    """Parse an address as in a bench file, `host:port`, or the path of a serial port. Raises InputError."""
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
    """Return the drivers of these names, or all, that can recognise instruments. Raises InputError."""
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
) -> list[AddressScan]:  # fmt: skip
    """Scan these addresses; also the serial ports of this machine, on request or without addresses. Raises InputError.

    A result without a candidate has the reason as text.
    """
    known, addresses = recognising(drivers), [address_of(text) for text in texts]
    if serial if serial is not None else not texts:
        given = {os.path.realpath(address.path) for address in addresses if address.path}
        ports = [port.path for port in serial_ports() if os.path.realpath(port.path) not in given]
        addresses += [address_of(port) for port in ports]

    async def look(address: Address) -> AddressScan:
        try:
            with address_lock([address], "a scan"):
                return await scan(address, RealWires(), known, units=units, baud=baud)
        except InUseError as problem:
            return AddressScan(address, words=str(problem))

    async def main() -> list[AddressScan]:
        return await asyncio.gather(*(look(address) for address in addresses))

    return run_loop(main(), REAL_TIME)


async def scan(
    address: Address, wires: Wires, drivers: Sequence[Known], *, units: Sequence[int] = (1,), baud: int = 0
) -> AddressScan:
    """Identify the instruments at an address, within PLACE_LIMIT_S."""
    usable = [known for known in drivers if address.scheme in known[0].schemes]
    if not usable:
        return AddressScan(
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
            return AddressScan(address, words=problem.problem)
        look.words = f"accepted {look.connected} connections, then refused more"
    except TimeoutError:
        look.words = f"scan not finished within {PLACE_LIMIT_S:g} s"
    return AddressScan(address, tuple(look.candidates), look.words or ("" if look.candidates else look.silence))


def _settings(address: Address, drivers: Sequence[Known], baud: int) -> Iterator[tuple[Address, list[Known]]]:
    """Yield the address with every useful line setting, and the drivers to try there."""
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
        self._answers: Mapping[bytes, bytes] = {}
        self._address, self._wires, self._units = address, wires, units

    @property
    def silence(self) -> str:
        """Reason why no instrument was recognised."""
        if not self._answers:
            return "no answer"
        question, answer = next(iter(self._answers.items()))
        return (
            f"an instrument answers that no driver recognises: sent {printable(question)}, received {printable(answer)}"
        )

    async def at(self, address: Address, drivers: Sequence[Known]) -> None:
        """Try the protocols of these drivers."""

        def language(known: Known) -> tuple[int, str]:
            return known[1].language.rank, known[1].language.name

        for _, group in groupby(sorted(drivers, key=language), key=language):
            speaking = list(group)
            for unit_id in self._numbers(speaking[0][1].language):
                await self._query_protocol(address, speaking, unit_id)
            if self.candidates:
                return

    def _numbers(self, language: Language) -> Sequence[int]:
        return self._units if language.numbered else self._units[:1]

    async def _query_protocol(self, address: Address, drivers: Sequence[Known], unit_id: int) -> None:
        """Query in one protocol; generic drivers only if no other one recognises the instrument."""
        if self.connected:
            await asyncio.sleep(BETWEEN_CONNECTIONS_S)
        async with QueryPort(self._wires, address, unit_id) as port:
            self.connected += 1
            found = await _known_by([known for known in drivers if not known[1].generic], port, address)
            found = found or await _known_by([known for known in drivers if known[1].generic], port, address)
        self.candidates += found
        self._answers = self._answers or {question: answer for question, answer in port.answers.items() if answer}


async def _known_by(drivers: Sequence[Known], port: QueryPort, address: Address) -> list[Candidate]:
    candidates = []
    for driver, recognition in drivers:
        try:
            found = await recognition.recognise(port)
        except ValueError:  # another instrument, or no answer
            continue
        candidates.append(Candidate(address, port.unit_id, driver, recognition, found))
    return candidates

"""Registers over Modbus TCP; the only importer of pymodbus."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from pymodbus import FramerType
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from drivers.errors import CannotConnect, LinkLost, NoAnswer, Refused
from drivers.transport.address import Address

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # what it logs, we raise

_EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address: the controller has no such register",
    3: "illegal data value: the controller refuses this setting",
    4: "server device failure",
    5: "acknowledge: still busy",
    6: "server device busy",
    10: "gateway path unavailable",
    11: "gateway target did not respond",
}


class ModbusLink:
    """Holding registers of one unit behind one TCP connection.

    Answers are matched by transaction id, so a late one is never taken for another. Reads are asked again once after
    a timeout; writes never are.
    """

    def __init__(self, device: str, address: Address, *, unit_id: int, answer_s: float = 3.0) -> None:
        self.device, self.address, self._unit_id, self._answer_s = device, address, unit_id, answer_s
        self._client: AsyncModbusTcpClient | None = None

    async def open(self) -> None:
        """Connects; raises CannotConnect."""
        self.close()
        client = AsyncModbusTcpClient(
            self.address.host, port=self.address.port, framer=FramerType.SOCKET, timeout=self._answer_s,
            retries=0, reconnect_delay=0,
        )  # fmt: skip
        if not await client.connect():
            client.close()
            raise CannotConnect(
                self.device, f"nobody answers at {self.address}",
                remedy="Check that the controller is on, its network address, and the port in the bench file.",
            )  # fmt: skip
        self._client = client

    @property
    def connected(self) -> bool:
        """Whether the connection is open."""
        return self._client is not None and self._client.connected

    async def read(self, address: int, count: int) -> tuple[int, ...]:
        """`count` holding registers from the wire address `address`; raises NoAnswer, Refused or LinkLost."""
        sent = f"read {count} registers at {address}"
        for attempt in (1, 2):
            try:
                answer = await self._request(sent).read_holding_registers(address, count=count, device_id=self._unit_id)
            except ModbusException as problem:
                if attempt == 2 or not self.connected:
                    raise self._silent(sent) from problem
                continue
            self._accept(answer, sent)
            if len(answer.registers) != count:
                raise Refused(self.device, f"gave {len(answer.registers)} registers for {count}", sent=sent)
            return tuple(answer.registers)
        raise AssertionError("unreachable")

    async def write(self, address: int, values: Sequence[int]) -> None:
        """Writes registers from `address` in one request, never twice; raises NoAnswer, Refused or LinkLost."""
        sent = f"write {' '.join(f'{value:04x}' for value in values)} at {address}"
        client = self._request(sent)
        try:
            if len(values) == 1:
                answer = await client.write_register(address, values[0], device_id=self._unit_id)
            else:
                answer = await client.write_registers(address, list(values), device_id=self._unit_id)
        except ModbusException as problem:
            raise self._silent(sent) from problem
        self._accept(answer, sent)

    def close(self) -> None:
        """Closes the connection; closing twice is harmless."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def _request(self, sent: str) -> AsyncModbusTcpClient:
        if self._client is None or not self._client.connected:
            raise LinkLost(self.device, f"the connection to {self.address} is closed", sent=sent)
        return self._client

    def _silent(self, sent: str) -> NoAnswer | LinkLost:
        if not self.connected:
            return LinkLost(self.device, f"the connection to {self.address} was closed", sent=sent)
        return NoAnswer(
            self.device, f"no answer within {self._answer_s:g} s from {self.address}", sent=sent,
            remedy="Check that the controller is on and that nobody pulled the cable.",
        )  # fmt: skip

    def _accept(self, answer: ModbusPDU, sent: str) -> None:
        if answer.isError():
            code = getattr(answer, "exception_code", 0)
            reason = _EXCEPTIONS.get(code, "unknown")
            raise Refused(self.device, f"Modbus exception {code}, {reason}", sent=sent)

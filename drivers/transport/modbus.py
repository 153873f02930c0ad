"""Registers over Modbus TCP; the only importer of pymodbus."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Sequence
from typing import Any

from pymodbus import FramerType
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ModbusPDU

from drivers.errors import BadAnswer, CannotConnect, LinkLost, NoAnswer, Refused
from drivers.transport.address import Address

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # what it logs, we raise

_READ, _WRITE_ONE, _WRITE_MANY, _REFUSED = 3, 6, 16, 0x80
# pymodbus keeps its time with asyncio.wait_for, which before Python 3.12 swallows a cancellation that comes together
# with the answer. Without a limit it only waits, and ModbusLink keeps the time.
_NO_TIMEOUT: Any = None
_EXCEPTIONS = {  # code: (what it means, what to do)
    1: ("illegal function", "Check that the driver fits the instrument."),
    2: ("no such register", "Check that the driver, and its options in the bench file, fit the instrument."),
    3: ("illegal value", "Check the limits and locks that are set at the instrument."),
    4: ("device failure", "Look at the instrument for an error."),
    5: ("acknowledged, still busy", "Wait until the instrument is ready, then start again."),
    6: ("busy", "Wait until the instrument is ready, then start again."),
    10: ("gateway path unavailable", "Check the unit id in the bench file and the gateway."),
    11: ("gateway target did not respond", "Check the unit id in the bench file and the wire behind the gateway."),
}


class ModbusLink:
    """Holding registers of one unit behind one TCP connection.

    Every request is sent once. Answers are matched by transaction id, so a late one is never taken for another; still,
    a timeout, an answer that does not fit and a cancelled request end the trust in the connection: it is closed, and
    its owner opens it again and asks who is there before anything else.

    Concurrency: one request at a time; callers take turns.
    """

    def __init__(self, device: str, address: Address, *, unit_id: int, answer_s: float = 3.0) -> None:
        self.device, self.address, self._unit_id, self._answer_s = device, address, unit_id, answer_s
        self._client: AsyncModbusTcpClient | None = None

    async def open(self) -> None:
        """Connects, anew if need be; raises CannotConnect."""
        self.close()

        def end_request(connected: bool) -> None:
            """Ends the request under way; pymodbus would let it wait for its whole time on a lost connection."""
            waiting = client.ctx.response_future
            if not connected and not waiting.done():
                waiting.set_exception(ConnectionException("the connection was closed"))
                waiting.exception()  # nobody may be waiting: it is then not an error that nobody saw

        client = AsyncModbusTcpClient(
            self.address.host, port=self.address.port, framer=FramerType.SOCKET, retries=0, reconnect_delay=0,
            timeout=_NO_TIMEOUT, trace_connect=end_request,
        )  # fmt: skip
        try:
            async with asyncio.timeout(self._answer_s):
                connected = await client.connect()
        except TimeoutError:
            connected = False
        except asyncio.CancelledError:
            client.close()
            raise
        if not connected:
            client.close()
            raise CannotConnect(
                self.device, f"nobody answers at {self.address}",
                remedy="Check that the controller is on, its network address, and the port in the bench file.",
            )  # fmt: skip
        self._client = client

    @property
    def is_open(self) -> bool:
        """Whether it was opened and not closed since; a connection that the other end dropped is noticed when asked."""
        return self._client is not None

    async def read(self, address: int, count: int) -> tuple[int, ...]:
        """`count` holding registers from the wire address `address`.

        Raises NoAnswer after the time for an answer, Refused for a Modbus exception, BadAnswer, LinkLost.
        """
        sent = f"read {count} registers at {address}"
        request = self._open_client(sent).read_holding_registers(address, count=count, device_id=self._unit_id)
        answer = await self._answer(request, _READ, sent)
        if len(answer.registers) != count:
            raise self._misfit(f"{len(answer.registers)} registers", sent)
        return tuple(answer.registers)

    async def write(self, address: int, words: Sequence[int]) -> None:
        """Writes registers from the wire address `address` in one request; raises as `read`.

        After NoAnswer and LinkLost nobody knows whether it was carried out: read back, then decide.
        """
        sent = f"write {' '.join(f'{word:04x}' for word in words)} at {address}"
        client = self._open_client(sent)
        if len(words) == 1:
            request = client.write_register(address, words[0], device_id=self._unit_id)
            answer = await self._answer(request, _WRITE_ONE, sent)
            confirmed = (answer.address, *answer.registers) == (address, words[0])
        else:
            request = client.write_registers(address, list(words), device_id=self._unit_id)
            answer = await self._answer(request, _WRITE_MANY, sent)
            confirmed = (answer.address, answer.count) == (address, len(words))
        if not confirmed:
            raise self._misfit(str(answer), sent)

    def close(self) -> None:
        """Closes the connection; closing twice is harmless."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def _open_client(self, sent: str) -> AsyncModbusTcpClient:
        if self._client is None or not self._client.connected:
            self.close()
            raise self._lost("is closed", sent)
        return self._client

    async def _answer(self, request: Awaitable[ModbusPDU], function: int, sent: str) -> ModbusPDU:
        """The answer to a request of `function`, when it is one and no refusal."""
        try:
            async with asyncio.timeout(self._answer_s):
                answer = await request
        except TimeoutError:
            self.close()
            raise NoAnswer(
                self.device, f"no answer within {self._answer_s:g} s from {self.address}", sent=sent,
                remedy="Check that the controller is on and that nobody pulled the cable.",
            ) from None  # fmt: skip
        except ModbusException as problem:
            self.close()
            raise self._lost("was closed", sent) from problem
        except asyncio.CancelledError:
            self.close()
            raise
        if answer.transaction_id == 0 or answer.function_code & ~_REFUSED != function:
            raise self._misfit(str(answer), sent)
        if answer.isError():
            code = answer.exception_code
            meaning, remedy = _EXCEPTIONS.get(code, ("unknown", "Look it up in the instrument's manual."))
            raise Refused(self.device, f"Modbus exception {code}, {meaning}", sent=sent, remedy=remedy)
        return answer

    def _lost(self, how: str, sent: str) -> LinkLost:
        return LinkLost(
            self.device, f"the connection to {self.address} {how}", sent=sent,
            remedy="Check the cable, and whether the instrument was restarted.",
        )  # fmt: skip

    def _misfit(self, received: str, sent: str) -> BadAnswer:
        self.close()
        return BadAnswer(
            self.device, "the answer does not fit the request", sent=sent, received=received,
            remedy="Check what is at this address, and that no gateway mixes up its clients.",
        )  # fmt: skip

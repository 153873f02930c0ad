"""Errors of instruments and connections. Every message names the device, what was sent and what was received."""

from __future__ import annotations


class DriverError(Exception):
    """A problem of one device. `code` is stable; the text is for the technician at the bench."""

    code = "device"

    def __init__(self, device: str, problem: str, *, sent: str = "", received: str = "", remedy: str = "") -> None:
        self.device, self.problem, self.sent, self.received, self.remedy = device, problem, sent, received, remedy
        parts = [f"{device}: {problem}"]
        if sent:
            parts.append(f"sent {sent}")
        if received:
            parts.append(f"received {received}")
        text = "; ".join(parts)
        super().__init__(f"{text}. {remedy}" if remedy else text)


class CannotConnect(DriverError):
    """No connection to the instrument."""

    code = "connect"


class LinkLost(DriverError):
    """The connection was lost."""

    code = "lost"


class NoAnswer(DriverError, TimeoutError):
    """The instrument did not answer in time; its connection must be drained and identified before further use."""

    code = "silent"


class BadAnswer(DriverError):
    """An answer that violates the protocol."""

    code = "answer"


class Refused(DriverError):
    """The instrument rejected a command, or its state differs from the command."""

    code = "refused"


class WrongIdentity(DriverError):
    """The identity differs from the bench file."""

    code = "identity"


class BeyondLimit(DriverError):
    """A setting beyond the limits of the instrument or the bench file; nothing was sent."""

    code = "limit"


class NotSettled(DriverError):
    """A motion or a temperature did not reach its target, or did not settle, in time."""

    code = "settle"


class InstrumentFault(DriverError):
    """A fault reported by the instrument: an alarm, a trip, an interlock, a counter that does not count."""

    code = "fault"


CODES = tuple(
    error.code
    for error in (
        CannotConnect, LinkLost, NoAnswer, BadAnswer, Refused, WrongIdentity, BeyondLimit, NotSettled, InstrumentFault,
    )
)  # fmt: skip

"""What an instrument or its wire can do wrong. Every message names the device, what was sent and what came back."""

from __future__ import annotations


class DriverError(Exception):
    """Something about one device. `code` is stable; the text is for the technician at the bench."""

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
    """Nobody at the other end of the wire."""

    code = "connect"


class LinkLost(DriverError):
    """The wire was open and is no more."""

    code = "lost"


class NoAnswer(DriverError, TimeoutError):
    """The instrument did not answer in time; its channel is not trusted until it has been drained and identified."""

    code = "silent"


class BadAnswer(DriverError):
    """An answer that the dialect does not allow."""

    code = "answer"


class Refused(DriverError):
    """The instrument understood and said no, or did something other than it was told."""

    code = "refused"


class WrongIdentity(DriverError):
    """Not the instrument that the bench file names."""

    code = "identity"


class BeyondLimit(DriverError):
    """A setting beyond what the instrument or the bench file allows; nothing was sent."""

    code = "limit"


class NotSettled(DriverError):
    """A process did not arrive or did not come to rest in time."""

    code = "settle"


class InstrumentFault(DriverError):
    """The instrument reports a fault of its own: an alarm, a trip, an interlock, a counter that stands still."""

    code = "fault"


CODES = tuple(
    error.code
    for error in (
        CannotConnect, LinkLost, NoAnswer, BadAnswer, Refused, WrongIdentity, BeyondLimit, NotSettled, InstrumentFault,
    )
)  # fmt: skip

"""Who is at the other end of a wire: whom the bench file pins, and the same one each time."""

from __future__ import annotations

from drivers.description import IdentityPin, check_identity
from drivers.errors import WrongIdentity
from drivers.values import Identity


class Recognised:
    """The instrument of one device; `identity` is None until it has been recognised."""

    def __init__(self, device: str, pin: IdentityPin) -> None:
        self._device, self._pin = device, pin
        self.identity: Identity | None = None

    def check(self, found: Identity, received: str) -> Identity:
        """The identity found; WrongIdentity if it is not as pinned, or, with what was received, not as before."""
        check_identity(self._device, self._pin, found)
        if self.identity not in (None, found):
            raise WrongIdentity(
                self._device, "another instrument has taken its place", received=received,
                remedy="Put the right instrument back at this address and run again.",
            )  # fmt: skip
        self.identity = found
        return found

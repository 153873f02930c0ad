"""Verification of an instrument's identity against the bench file, and against earlier connections."""

from __future__ import annotations

from drivers.description import IdentityPin, check_identity
from drivers.errors import WrongIdentity
from drivers.values import Identity


class Recognised:
    """The verified instrument of one device; `identity` is None until its first verification."""

    def __init__(self, device: str, pin: IdentityPin) -> None:
        self._device, self._pin = device, pin
        self.identity: Identity | None = None

    def check(self, found: Identity, received: str) -> Identity:
        """Verify an identity; WrongIdentity, with the received answer, if it differs from the pinned or earlier one."""
        check_identity(self._device, self._pin, found)
        if self.identity not in (None, found):
            raise WrongIdentity(
                self._device, "another instrument has taken its place", received=received,
                remedy="Put the right instrument back at this address and run again.",
            )  # fmt: skip
        self.identity = found
        return found


def as_stated(pin: IdentityPin, fingerprint: str, *, maker: str = "", model: str = "", firmware: str = "") -> Identity:
    """Identity of an instrument that reports no names: those of the bench file, otherwise these, unverified."""
    return Identity(
        maker=pin.maker or maker, model=pin.model or model, serial=pin.serial or "",
        firmware=firmware or pin.firmware or "", verified=False, fingerprint=fingerprint,
    )  # fmt: skip

"""Delays after failed attempts to log in. They grow, end by themselves, and ban nobody."""

from __future__ import annotations

from collections.abc import Callable
from ipaddress import ip_address, ip_network
from math import ceil

from bench.clock import since_boot_s
from bench.errors import InputError

KEPT = 2000
_IPV6_SITE = 64


class TooSoonError(InputError):
    """Attempt to log in sooner after failed ones than allowed; `wait_s` is the time to wait."""

    def __init__(self, wait_s: float) -> None:
        self.wait_s = wait_s
        super().__init__(f"too many attempts; try again in {ceil(wait_s)} s")


class Patience:
    """Failed attempts by name and address, and by address alone.

    Nobody at another address is delayed by them, so that guessing keeps no user out.
    """

    def __init__(self, now_s: Callable[[], float] = since_boot_s) -> None:
        self._now_s = now_s
        self._failed: dict[tuple[str, ...], tuple[int, float]] = {}

    def expect(self, name: str, address: str) -> None:
        """Raise TooSoonError while the delay after failed attempts lasts."""
        wait_s = max(self._wait_s(key, *limits) for key, limits in _keys(name, address))
        if wait_s > 0:
            raise TooSoonError(wait_s)

    def failed(self, name: str, address: str) -> int:
        """Count a failed attempt; return how many failed for this name from this address."""
        for key, _ in _keys(name, address):
            if len(self._failed) >= KEPT and key not in self._failed:
                self._failed.pop(next(iter(self._failed)))
            self._failed[key] = self._failed.pop(key, (0, 0.0))[0] + 1, self._now_s()
        return self._failed[_keys(name, address)[0][0]][0]

    def succeeded(self, name: str, address: str) -> None:
        """Forget the failed attempts of a name from an address."""
        self._failed.pop(_keys(name, address)[0][0], None)

    def _wait_s(self, key: tuple[str, ...], free: int, most_s: float) -> float:
        count, last_s = self._failed.get(key, (0, 0.0))
        return min(most_s, 2.0 ** min(count - free, 10)) - (self._now_s() - last_s) if count >= free else 0.0


def _keys(name: str, address: str) -> list[tuple[tuple[str, ...], tuple[int, float]]]:
    """Return keys, each with the number of attempts without a delay, and the longest delay in s."""
    site = _site(address)
    return [((site, name), (3, 30.0)), ((site,), (10, 1.0))]


def _site(address: str) -> str:
    """Return the address, or the network of an IPv6 address, which one computer may have all addresses of."""
    try:
        found = ip_address(address)
    except ValueError:
        return address
    return str(found if found.version == 4 else ip_network((found, _IPV6_SITE), strict=False))

"""Address of a station: what it writes for the commands of its user, or environment variables."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from bench.errors import InputError
from bench.store.user_state import state_folder

FOLDER = "station"  # below the folder of the user's state
WHERE, TOKEN = "station.json", "token"
LOOPBACK = ("localhost", "127.0.0.1", "::1")  # hosts that are this computer
URL_VARIABLE, TOKEN_VARIABLE, CERTIFICATE_VARIABLE = "BENCH_STATION", "BENCH_TOKEN", "BENCH_CERTIFICATE"
_THIS_COMPUTER = {"//0.0.0.0:": "//127.0.0.1:", "//[::]:": "//[::1]:"}


class Address(NamedTuple):
    """Address of a station.

    `certificate` is the only one that is accepted of it, without one those that the system trusts. `runs` is the folder
    of its runs if the station is on this computer.
    """

    url: str
    token: str
    certificate: Path | None = None
    runs: Path | None = None


def default_folder() -> Path:
    """Return the folder of the station of this user."""
    return state_folder() / FOLDER


def announcement(url: str, runs: Path, certificate: Path | None) -> bytes:
    """Return the content of `station.json`, for a station in this process."""
    for every, this in _THIS_COMPUTER.items():
        url = url.replace(every, this)
    only = str(certificate.absolute()) if certificate else ""
    return json.dumps({"url": url, "pid": os.getpid(), "runs": str(runs), "certificate": only}).encode()


def announced(folder: Path) -> Address | None:
    """Return the address of the station that works in a folder, or None. Raises InputError.

    After a station was killed another program may have its port: without the process there is no address, and no token
    is sent.
    """
    try:
        found = json.loads((folder / WHERE).read_bytes())
        if Path(f"/proc/{int(found['pid'])}").stat().st_uid != (folder / WHERE).stat().st_uid:
            return None
        token = (folder / TOKEN).read_text("ascii").strip()
        return Address(str(found["url"]), token, _path(found.get("certificate")), _path(found.get("runs")))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise InputError(f"{folder / WHERE}: cannot be used ({problem}); start the station again") from problem


def from_environment(variables: Mapping[str, str] = os.environ) -> Address | None:
    """Return the address of $BENCH_STATION with $BENCH_TOKEN, or None. Raises InputError if the token is missing."""
    if not (url := variables.get(URL_VARIABLE, "")):
        return None
    if not (token := variables.get(TOKEN_VARIABLE, "")):
        raise InputError(f"${URL_VARIABLE} is set and ${TOKEN_VARIABLE} is not; 'bench tokens new LABEL' makes a token")
    return Address(url, token, _path(variables.get(CERTIFICATE_VARIABLE)))


def found_address(folder: Path | None = None) -> Address | None:
    """Return the address of $BENCH_STATION, else that of the station in a folder, or None. Raises InputError."""
    return (from_environment() if folder is None else None) or announced(folder or default_folder())


def _path(text: object) -> Path | None:
    return Path(str(text)) if text else None

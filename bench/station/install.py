"""Files that make a station a service of the computer: units of systemd, its user, rules for polkit and udev."""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from bench.config.load import shipped
from bench.errors import InputError, StoreError
from bench.files import make_folder, write_atomically

PROGRAM = "/opt/inertial-test-bench/bin/bench"  # in the shipped files
SETTINGS = Path("/etc/inertial-test-bench/station.yaml")
STATE = "/var/lib/inertial-test-bench"
PLACES = {
    "bench.sysusers.conf": "/etc/sysusers.d/inertial-test-bench.conf",
    "bench.tmpfiles.conf": "/etc/tmpfiles.d/inertial-test-bench.conf",
    "bench-station.service": "/etc/systemd/system/bench-station.service",
    "bench-item@.service": "/etc/systemd/system/bench-item@.service",
    "50-bench.rules": "/etc/polkit-1/rules.d/50-bench.rules",
    "71-bench-station.rules": "/etc/udev/rules.d/71-bench-station.rules",
}
STARTER = f"""\
schema: itb-station/1
title: Bench station
benches:
  demo: {{file: simulated}}
runs: {STATE}/runs
"""
HIDDEN = ("/home/", "/root/", "/run/user/", "/tmp/", "/var/tmp/")  # noqa: S108  by ProtectHome and PrivateTmp
_PLAIN = re.compile(r"/[A-Za-z0-9_./@+-]+")  # systemd reads spaces, quotes and % in a command as its own


class ServiceFile(NamedTuple):
    """File of the service: its path, its text, and the text that is there now, None without a file."""

    path: Path
    text: str
    present: str | None
    keep: bool = False  # settings of the laboratory: written once, never compared

    @property
    def state(self) -> str:
        """One of new, unchanged, kept and differs."""
        if self.present is None:
            return "new"
        return "kept" if self.keep else "unchanged" if self.present == self.text else "differs"

    def difference(self) -> Iterator[str]:
        """Yield the lines in which the present file differs from this one."""
        if self.state == "differs":
            here, ours = (self.present or "").splitlines(), self.text.splitlines()
            yield from difflib.unified_diff(here, ours, f"{self.path} (present)", f"{self.path} (ours)", lineterm="")

    def write(self) -> None:
        """Write the file, readable by everybody. Raises StoreError."""
        try:
            make_folder(self.path.parent)
        except OSError as problem:
            raise StoreError(f"{self.path.parent}: cannot be created ({problem}); run this as root") from problem
        write_atomically(self.path, self.text.encode())
        self.path.chmod(0o644)


def service_files(root: Path, program: Path, settings: Path) -> list[ServiceFile]:
    """Return the files of the service for a program and a settings file, below a root folder. Raises InputError."""
    for path in (program, settings):
        if not _PLAIN.fullmatch(str(path)):
            raise InputError(f"{path}: a service needs an absolute path of letters, digits and _ . / @ + -")
    found = [_file(root, path, _text(name, program, settings)) for name, path in PLACES.items()]
    return [*found, _file(root, str(settings), STARTER)._replace(keep=True)]


def own_program() -> Path:
    """Return the path of this program: by the link PLACE that leads to PLACE-VERSION, if there is one."""
    own = Path(sys.executable).parent / "bench"
    folder = own.parents[1]
    link = folder.with_name(folder.name.removesuffix(f"-{version('inertial-test-bench')}"))
    return link / "bin" / "bench" if link.is_symlink() and link.samefile(folder) else own


def by_hand(program: Path) -> list[str]:
    """Return what a person does after the files are written, as commands and remarks."""
    remarks = []
    if str(program).startswith(HIDDEN):
        remarks.append(f"# {program}: services cannot see this folder; install the program in /opt and repeat this")
    return [
        *remarks,
        "systemd-sysusers",
        "systemd-tmpfiles --create",
        "# write the serial numbers of your adapters into /etc/udev/rules.d/71-bench-station.rules, then:",
        "udevadm control --reload && udevadm trigger",
        "systemctl daemon-reload",
        "systemctl enable --now bench-station",
        "systemctl status bench-station",
    ]


def _text(name: str, program: Path, settings: Path) -> str:
    shipped_file = next(file for folder in shipped("config") if (file := folder / "services" / name).is_file())
    text = shipped_file.read_text("utf-8")
    return text.replace(PROGRAM, str(program)).replace(str(SETTINGS), str(settings))


def _file(root: Path, path: str, text: str) -> ServiceFile:
    place = root / path.lstrip("/")
    try:
        return ServiceFile(place, text, place.read_text("utf-8", errors="replace") if place.exists() else None)
    except OSError as problem:
        raise InputError(f"{place}: cannot be read ({problem})") from None

"""The how-to of a laboratory, command by command in an empty folder, with the programs that it names."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import closing
from pathlib import Path

import pytest

from tests.support.how_to import FOLDER
from tests.support.runs import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.peer("mosquitto", "moto")]
PAGE = (FOLDER / "laboratory.md").read_text()
PLACES = {"mosquitto": "1884", "moto_server": "5055", "bench serve": "8421", "bench station": "8422", "dask": "8786"}
STARTS_S, ENDS_S = 60.0, 180.0
PORTS = ("1884", "5055", "8421", "8422", "8786")
COMMANDS = 10


class Shell:
    """A folder in which commands are typed, with the programs of this environment first in the path."""

    def __init__(self, folder: Path, exports: dict[str, str]) -> None:
        self.folder = folder
        state, runtime = folder / "state", folder / "runtime"
        runtime.mkdir(mode=0o700)
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}:/usr/sbin"
        self._env = {
            **os.environ, **exports, "PATH": path, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(state),
            "XDG_RUNTIME_DIR": str(runtime),
        }  # fmt: skip
        self._started: list[subprocess.Popen[bytes]] = []

    def start(self, command: str) -> None:
        """Type a command that stays, in a group of its own."""
        with (self.folder / "printed.txt").open("ab") as printed:
            self._started.append(subprocess.Popen(
                command, shell=True, cwd=self.folder, env=self._env, stdout=printed, stderr=printed,
                start_new_session=True,
            ))  # fmt: skip

    def run(self, command: str) -> str:
        """Type a command and wait for its end; what it prints."""
        found = subprocess.run(
            command, shell=True, cwd=self.folder, env=self._env, capture_output=True, text=True, timeout=ENDS_S,
            check=False,
        )  # fmt: skip
        assert found.returncode == 0, f"{command}: {found.stdout}{found.stderr}"
        return found.stdout

    def end(self) -> None:
        """End all that stays."""
        for process in reversed(self._started):
            os.killpg(process.pid, signal.SIGTERM)
        for process in self._started:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def until_it_listens(port: int) -> None:
    until = time.monotonic() + STARTS_S
    while time.monotonic() < until:
        with closing(socket.socket()) as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise AssertionError(f"nobody listens at {port}")


def free_ports() -> dict[str, str]:
    """Other ports for those of the page, which may be in use here."""
    sockets = [socket.socket() for _ in PORTS]
    for each in sockets:
        each.bind(("127.0.0.1", 0))
    found = {port: str(each.getsockname()[1]) for port, each in zip(PORTS, sockets, strict=True)}
    for each in sockets:
        each.close()
    return found


def test_the_ten_commands_do_what_the_page_says(tmp_path) -> None:
    (settings,) = re.findall("```yaml\n(.*?)```", PAGE, re.DOTALL)
    exports, commands = re.findall("```bash\n(.*?)```", PAGE, re.DOTALL)
    ports = free_ports()

    def here(text: str) -> str:
        for port, other in ports.items():
            text = text.replace(port, other)
        return text

    (tmp_path / "station.yaml").write_text(here(settings))
    shell = Shell(tmp_path, dict(re.findall(r"(\w+)=(\S+)", here(exports))))
    typed = here(commands).strip().splitlines()
    assert len(typed) == COMMANDS
    printed = []
    try:
        for command in typed:
            if not command.endswith("&"):
                printed.append(shell.run(command))
                continue
            start = command.removesuffix("&")
            own = {"bench serve": f" --port {ports['8421']}", "bench station": f" --port {ports['8422']}"}
            start += next((port for name, port in own.items() if command.startswith(name)), "")
            shell.start(start)
            until_it_listens(int(ports[next(port for name, port in PLACES.items() if command.startswith(name))]))
        for port in ("8421", "8422"):
            with urllib.request.urlopen(f"http://127.0.0.1:{ports[port]}/login", timeout=20) as page:
                assert b"<form" in page.read()
    finally:
        shell.end()
    submitted, pushed, asked, reduced = printed[-4:]
    assert len(re.findall(r"smoke_QF-000[abc]: completed, PASS", submitted)) == 3
    assert pushed.count("version 1 published to s3://lab/archive/") == 3
    assert {"QF-000a", "QF-000b", "QF-000c"} <= set(asked.split())
    assert "3 runs with 15 findings; 0 rows in campaigns-done/reduce/changes.csv" in reduced

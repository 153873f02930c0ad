"""Fixtures of all tests, and what happens where a third-party program is missing."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable
from ctypes.util import find_library
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

import bench.loop
import tests  # noqa: F401  which gives them a folder for states
from tests.support.commands import Done, invoked
from tests.support.postgres import postgres_program
from tests.support.shared_runs import SharedRuns

if TYPE_CHECKING:
    from bench.app.execute import RunResult

pytest_plugins = ["tests.support.budget", "tests.support.turns"]
ROOT = Path(__file__).parents[1]
# The same examples in every run, so that a change is judged by itself; HYPOTHESIS_PROFILE=explore looks for new ones.
# A busy machine is no failure, so no example has a deadline.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("explore", print_blob=True, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))
SLOW_FOLDERS = {"truth", "integration", "campaigns"}
REQUIRED = os.environ.get("BENCH_REQUIRE_PEERS") == "1"
PEER_MODULES = {
    "pymeasure": ("pymeasure", "pyvisa", "pyvisa_py"), "msgpack": ("msgpack",), "imucal": ("imucal",),
    "chamberconnectlibrary": ("chamberconnectlibrary",), "espec_pr3j": ("espec_pr3j", "pyvisa_py"),
    "newportxps": ("newportxps",), "lewis": ("lewis",), "sinstruments": ("sinstruments",),
    "qcodes": ("qcodes", "pyvisa_py"), "pyvisa": ("pyvisa", "pyvisa_py"), "cts_chamber": ("cts_chamber", "pyvisa_py"),
    "pyModbusTCP": ("pyModbusTCP",), "watlow_f4": ("watlow_f4", "minimalmodbus"),
    "dvg_devices": ("dvg_devices", "dvg_debug_functions", "pyvisa_py"), "daqmon": ("daqmon",),
    "playwright": ("playwright",), "modbus_tk": ("modbus_tk",), "canmatrix": ("canmatrix",),
    "sphinx": ("sphinx", "furo", "myst_parser"), "moto": ("moto",), "psycopg": ("psycopg",),
}  # fmt: skip


def pytest_configure() -> None:
    """Undo what a shell does to programs in the background: runs that the tests start would ignore Ctrl-C as well."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)  # others look at these marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the folders of slow tests.

    Skips a peer's tests, with the reason, where the peer is missing; where peers are required they fail instead.
    """
    for item in items:
        if SLOW_FOLDERS & set(item.path.relative_to(ROOT / "tests").parts):
            item.add_marker(pytest.mark.slow)
        for marker in item.iter_markers("peer"):
            missing = [name for name in marker.args if not _is_here(name)]
            if missing and not REQUIRED:
                item.add_marker(pytest.mark.skip(reason=f"{', '.join(missing)} is not here; `make peers` installs it"))


def _is_here(peer: str) -> bool:
    if peer in ("azurite", "s3rver"):
        return (ROOT / "build" / "npm" / peer / "node_modules" / peer).is_dir()
    if peer == "postgres":
        return postgres_program("initdb") is not None and importlib.util.find_spec("psycopg") is not None
    if peer == "libmodbus":
        return find_library("modbus") is not None
    if peer == "a Chinese font":
        return shutil.which("fc-list") is not None and bool(subprocess.check_output(["fc-list", ":lang=zh"]))
    modules = PEER_MODULES.get(peer)
    if modules is not None:
        return all(importlib.util.find_spec(module) is not None for module in modules)
    return shutil.which(peer) is not None


@pytest.fixture(scope="session", autouse=True)
def _state_of_nobody(tmp_path_factory):
    """Keeps the records that belong to no single run out of the home of whoever runs the tests."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("itb-state-"))


@pytest.fixture
def own_state(tmp_path, monkeypatch) -> Path:
    """Folder of the records of this user, for one test alone."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "inertial-test-bench"


@pytest.fixture(scope="session")
def shared_runs(request, tmp_path_factory) -> SharedRuns:
    base = tmp_path_factory.getbasetemp()
    return SharedRuns((base.parent if hasattr(request.config, "workerinput") else base) / "shared-runs")


@pytest.fixture
def smoke_run(shared_runs) -> RunResult:
    """The smoke sequence on the simulated bench, with its report; to be looked at only."""
    return shared_runs.smoke()


@pytest.fixture
def tumble_run(shared_runs) -> RunResult:
    """A short tumble of three dwells, up and down, with its report; to be looked at only."""
    return shared_runs.tumble()


@pytest.fixture
def smoke_copy(smoke_run, tmp_path) -> Path:
    """The directory of the smoke run once more, to be changed."""
    return Path(shutil.copytree(smoke_run.path, tmp_path / "runs" / smoke_run.path.name))


@pytest.fixture(autouse=True)
def _shared_runs_stay(shared_runs):
    """Fails a test that has changed a run that others look at."""
    before = shared_runs.changed()
    yield
    assert shared_runs.changed() == before, "take a copy of a shared run before changing it"


_OF_SOMETHING: dict[str, bool] = {}  # lines on which the present test has called all(), and whether it got anything


def _noted_all(values: Iterable[object]) -> bool:
    """As all(); notes where it is of nothing, of which everything is true."""
    caller = sys._getframe(1)
    line = f"{caller.f_code.co_filename}:{caller.f_lineno}"
    _OF_SOMETHING.setdefault(line, False)
    for value in values:
        _OF_SOMETHING[line] = True
        if not value:
            return False
    return True


def pytest_pycollect_makeitem(collector: pytest.Module | pytest.Class) -> None:
    """Let every module of tests note its calls of all()."""
    if isinstance(collector, pytest.Module):
        vars(collector.obj).setdefault("all", _noted_all)


@pytest.fixture(autouse=True)
def _all_is_of_something():
    """Fails a test in which all() was never of anything on one of its lines, also over all examples of a property."""
    _OF_SOMETHING.clear()
    yield
    nothing = [line for line, some in _OF_SOMETHING.items() if not some]
    assert not nothing, f"all() of nothing is always true; assert before what there must be: {nothing}"


_LEFT_TASKS: list[str] = []  # of the loops that the present test has run


def _noting(end: Callable[[], Awaitable[None]]) -> Callable[[], Awaitable[None]]:
    async def noted() -> None:
        left = asyncio.all_tasks() - {asyncio.current_task()}
        _LEFT_TASKS.extend(f"{task.get_name()}: {task.get_coro()}" for task in left if not task.cancelling())
        await end()

    return noted


bench.loop._end_tasks = _noting(bench.loop._end_tasks)  # type: ignore[assignment]


_FONTS = re.compile(r"\.(tt[cf]|otf)$")  # matplotlib keeps open what it has drawn with


def _held() -> tuple[Counter[str], set[threading.Thread]]:
    """Files, sockets and pipes that this process holds, by what they are, and its threads."""
    descriptors = Counter[str]()
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            held = os.readlink(f"/proc/self/fd/{name}")
            descriptors[re.sub(r"\[\d+\]", "", held)] += not _FONTS.search(held)
    return descriptors, set(threading.enumerate())


@pytest.fixture(autouse=True)
def _nothing_is_left(request):
    """Fails a test after which tasks were cut off, or a thread, a socket or a file is left."""
    if "leaves" in request.keywords:
        yield
        return
    _LEFT_TASKS.clear()
    before, threads = _held()
    yield
    after, now = _held()
    if after - before:  # what is referred to in a circle is closed by the collector
        gc.collect()
        after, _ = _held()
    for thread in now - threads:
        thread.join(1.0)  # one that was asked to end is given the time to do so
    left = [*_LEFT_TASKS, *(after - before), *(str(each) for each in now - threads if each.is_alive())]
    assert not left, f"left behind: {left}"


@pytest.fixture
def bench_command():
    """Runs `bench` as a process of its own: arguments in; exit code, stdout and stderr out."""

    def run(
        *arguments: object, cwd: Path | None = None, env: dict[str, str] | None = None, timeout_s: float = 50,
        stdout: Any = subprocess.PIPE,
    ):  # fmt: skip
        return subprocess.run(
            [sys.executable, "-m", "bench", *map(str, arguments)], stdout=stdout, stderr=subprocess.PIPE, text=True,
            timeout=timeout_s, cwd=cwd or ROOT, env={**os.environ, "PYTHONPATH": str(ROOT), **(env or {})}, check=False,
        )  # fmt: skip

    return run


@pytest.fixture
def bench_here(monkeypatch):
    """Runs `bench` as bench_command does, but in this process, which saves the start of another one."""

    def run(*arguments: object, cwd: Path | None = None, env: dict[str, str] | None = None) -> Done:
        with monkeypatch.context() as patched:
            patched.chdir(cwd or ROOT)
            for name, value in (env or {}).items():
                patched.setenv(name, value)
            return invoked(*map(str, arguments))

    return run

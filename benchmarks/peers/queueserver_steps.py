"""Plans a second through the queue of bluesky-queueserver, each of them nothing: COUNT.

With a redis-server of its own on this computer; all plans are in the queue before it is started.
"""

import contextlib
import json
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bluesky_queueserver
from bluesky_queueserver.manager.comms import zmq_single_request

logging.disable(logging.CRITICAL)
STARTUP = """
import bluesky.plan_stubs as bps
from bluesky.run_engine import RunEngine
RE = RunEngine({})


def nothing():
    yield from bps.null()
"""


def free_port() -> int:
    """A port of this computer that nobody uses."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


REDIS, CONTROL, INFO = free_port(), f"tcp://127.0.0.1:{free_port()}", f"tcp://127.0.0.1:{free_port()}"


def call(method: str, **given: object) -> dict:
    """The reply of the manager; empty while there is none."""
    reply, _ = zmq_single_request(method, given, timeout=20_000, zmq_server_address=CONTROL)
    return reply or {}


def wait_for(condition: Callable[[], bool], limit_s: float) -> None:
    """Wait until the condition is true."""
    began_s = time.monotonic()
    while not condition():
        assert time.monotonic() - began_s < limit_s, "the manager does not get on"
        time.sleep(0.02)


@contextlib.contextmanager
def manager(folder: Path) -> Iterator[None]:
    """A manager with its redis-server, ready to execute plans."""
    shipped = Path(bluesky_queueserver.__file__).parent / "profile_collection_sim"
    shutil.copy(shipped / "user_group_permissions.yaml", folder)
    (folder / "startup.py").write_text(STARTUP, "utf-8")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder, "start_new_session": True}
    redis = [*f"redis-server --port {REDIS} --bind 127.0.0.1 --appendonly no --save".split(), ""]
    program = str(Path(sys.executable).parent / "start-re-manager")
    sockets = f"--redis-addr localhost:{REDIS} --zmq-control-addr {CONTROL} --zmq-info-addr {INFO}"
    with (
        ended(subprocess.Popen(redis, **quiet)),
        ended(subprocess.Popen([program, "--startup-dir", folder, *sockets.split()], **quiet)),
    ):
        wait_for(lambda: call("status").get("manager_state") == "idle", 60)
        wait_for(lambda: call("environment_open").get("success", False), 60)
        wait_for(lambda: call("status").get("worker_environment_state") == "idle", 60)
        yield
        call("environment_close")
        wait_for(lambda: not call("status").get("worker_environment_exists", True), 60)


@contextlib.contextmanager
def ended(process: subprocess.Popen) -> Iterator[None]:
    """End a process, and those that it started, with the block."""
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        process.wait(20)


def is_done() -> bool:
    """True if the queue is empty and nothing runs."""
    status = call("status")
    return status.get("items_in_queue") == 0 and status.get("manager_state") == "idle"


asked = int(sys.argv[1])
with tempfile.TemporaryDirectory() as name, manager(Path(name)):
    for _ in range(asked):
        item = {"name": "nothing", "item_type": "plan"}
        assert call("queue_item_add", item=item, user="bench", user_group="primary")["success"]
    began_s = time.perf_counter()
    call("queue_start")
    wait_for(is_done, 600)
    took_s = time.perf_counter() - began_s
print(json.dumps({"steps_per_s": asked / took_s}))

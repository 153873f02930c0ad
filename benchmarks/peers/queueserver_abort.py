"""Aborts of a running plan with bluesky-queueserver: `python queueserver_abort.py COUNT`.

An abort is two requests: a pause at once, and when the plan is paused, the abort. It is accepted when the second is
answered, and done when the manager is idle: the plan has put its device into its safe state. Redis keeps nothing on a
disk. All of it is on free ports of the loopback.
"""

import contextlib
import json
import random
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bluesky_queueserver
from bluesky_queueserver.manager.comms import zmq_single_request

USER = {"user": "bench", "user_group": "primary"}
STARTUP = """
import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
from bluesky.run_engine import RunEngine
from ophyd.sim import motor

RE = RunEngine({})


def slow(n: int = 600):
    def steps():
        yield from bps.open_run()
        for at in range(n):
            yield from bps.mv(motor, at)
            yield from bps.sleep(0.5)
        yield from bps.close_run()

    yield from bpp.finalize_wrapper(steps(), bps.mv(motor, 0))
"""
LOOK_EVERY_S, LIMIT_S = 0.002, 60.0


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Manager:
    """A manager with its own Redis."""

    def __init__(self, folder, stack):
        redis, control, info = free_port(), *(f"tcp://127.0.0.1:{free_port()}" for _ in range(2))
        self._control = control
        given = Path(bluesky_queueserver.__file__).parent / "profile_collection_sim" / "user_group_permissions.yaml"
        shutil.copy(given, folder)
        Path(folder, "startup.py").write_text(STARTUP)
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
        keeps_nothing = ["--save", "", "--appendonly", "no"]
        server = ["redis-server", "--port", str(redis), "--bind", "127.0.0.1", *keeps_nothing]
        stack.callback(ended, subprocess.Popen(server, **quiet))
        program = Path(sys.executable).parent / "start-re-manager"
        addresses = ["--redis-addr", f"localhost:{redis}", "--zmq-control-addr", control, "--zmq-info-addr", info]
        stack.callback(ended, subprocess.Popen([program, "--startup-dir", folder, *addresses], **quiet))
        self.until(lambda: self.call("status", timeout=500).get("manager_state") == "idle")
        self.asked("environment_open")
        stack.callback(self.call, "environment_destroy")
        self.until(lambda: self.call("status").get("worker_environment_state") == "idle")

    def call(self, method, params=None, timeout=10_000):
        reply, error = zmq_single_request(method, params, zmq_server_address=self._control, timeout=timeout)
        return {"error": error} if reply is None else reply

    def asked(self, method, params=None):
        """Ask until it is done: a manager that changes its state refuses."""
        self.until(lambda: self.call(method, params).get("success"))

    def is_in(self, state):
        return self.call("status").get("manager_state") == state

    def until(self, test):
        end_s = time.monotonic() + LIMIT_S
        while not test():
            if time.monotonic() > end_s:
                raise TimeoutError(f"not within {LIMIT_S:g} s")
            time.sleep(LOOK_EVERY_S)

    def abort_s(self, wait_s):
        """How long one abort took until it was accepted, and until it was done."""
        item = {"name": "slow", "item_type": "plan", "kwargs": {}}
        self.asked("queue_item_add", {"item": item, **USER})
        self.asked("queue_start")
        self.until(lambda: self.is_in("executing_queue"))
        self.until(lambda: self.call("status").get("re_state") == "running")
        time.sleep(wait_s)
        began_s = time.perf_counter()
        self.asked("re_pause", {"option": "immediate"})
        self.until(lambda: self.is_in("paused"))
        self.asked("re_abort")
        accepted_s = time.perf_counter() - began_s
        self.until(lambda: self.is_in("idle"))
        done_s = time.perf_counter() - began_s
        self.asked("queue_clear")
        return accepted_s, done_s


def ended(process):
    process.terminate()
    process.wait(10)


def main():
    draws = random.Random(1)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        manager = Manager(folder, stack)
        found = [manager.abort_s(draws.uniform(0.2, 1.2)) for _ in range(int(sys.argv[1]))]
    print(json.dumps({"accepted_s": [each for each, _ in found], "done_s": [each for _, each in found]}))


if __name__ == "__main__":
    main()

"""Entry point of the guardian process, started by a run."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

from bench.guardian.watch import ARMED, CANNOT, LONGEST, Over, watch


def main(link_number: str, runner_number: str, run: str, bench: str, digest: str) -> int:
    """Watch a run until it ends; make its bench safe if it dies. Return 6 if that failed.

    `link_number` is the inherited socket to the run, `runner_number` the number of its process, `run` its directory,
    and `bench` its bench file with the SHA-256 `digest`.
    """
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    link, runner = socket.socket(fileno=int(link_number)), os.pidfd_open(int(runner_number))
    if os.getppid() != int(runner_number):
        return 0  # the run died before anything was energised
    try:
        from bench.guardian.rescue import Rescue

        rescue = Rescue(Path(run), Path(bench), digest, int(runner_number))
    except Exception as problem:  # noqa: BLE001  any error is reported to the run, which then refuses to start
        link.send((CANNOT + str(problem).encode())[:LONGEST])
        return 2
    link.send(ARMED)
    end = watch(link, runner, polls_within_s=rescue.polls_within_s, alarm=rescue.alarm)
    if isinstance(end, Over):
        link.close()
        rescue.leave(end)
        return 0
    return 0 if rescue.make_safe(end) else 6

"""Signals in every phase of a run, and terminals that go or hang: exit code, record, and the bench read by itself."""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

from campaigns.trials.rows import Row
from tests.support.energised import ENERGISED, SAFE, Process, Wires, wires

INT, TERM, HUP, QUIT = signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT
SENT: tuple[tuple[signal.Signals, ...], ...] = ((INT,), (TERM,), (HUP,), (QUIT,), (INT, INT), (TERM, TERM), (HUP, TERM))
SHORT = ("--set", "time=1 s")
BY = {INT: "interrupt", TERM: "terminate", HUP: "hang-up", QUIT: "quit"}

Wait = Callable[[Process], object]
PHASES: dict[str, tuple[tuple[str, ...], Wait]] = {
    "opening": ((), lambda run: run.until(lambda: (run.path / "run.db").exists())),
    "setup": ((), lambda run: run.until_step("setup/wait")),
    "steps": ((), lambda run: run.until_step("steps/wait")),
    "teardown": (SHORT, lambda run: run.until_step("teardown/wait")),
    "writing results": (SHORT, lambda run: run.until(lambda: "run_ended" in run.kinds())),
    "report": (SHORT, lambda run: run.until(lambda: (run.path / "results.json").exists())),
}
AS_WISHED = "safe, exit code and record as documented"
AFTER = ("writing results", "report")  # how the run ended is decided


def trials(scale: float) -> Iterator[Row]:
    """One row for each phase, and for each way in which a terminal is lost."""
    with tempfile.TemporaryDirectory() as folder, wires(Path(folder)) as bench:
        some = sample(list(product(PHASES, SENT)), scale)
        for phase in dict.fromkeys(phase for phase, _ in some):
            tried = [sent for each, sent in some if each == phase]
            yield row_of(
                f"signals while {phase}", [(_name(sent), partial(_signalled, phase, sent)) for sent in tried], bench
            )
        terminals: list[tuple[str, Trial]] = [
            ("nohup", _ignored), ("terminal closed", _closed), ("nobody reads", _hangs), ("reader gone", _no_reader),
        ]  # fmt: skip
        yield row_of("terminals", sample(terminals, scale), bench)


def sample(trials: list, scale: float) -> list:  # type: ignore[type-arg]  # of whatever
    """So many of the trials, spread over all of them."""
    count = max(1, round(len(trials) * scale))
    return [trials[number * len(trials) // count] for number in range(count)]


Trial = Callable[[Wires, Path], str]


def row_of(line: str, some: list[tuple[str, Trial]], bench: Wires, as_wished: str = AS_WISHED) -> Row:
    """The result of trials, each on the energised bench and in a folder of its own; "" is as it should be."""
    wrong = []
    for name, trial in some:
        with tempfile.TemporaryDirectory() as folder:
            bench.energise()
            assert bench.state() == ENERGISED
            found = trial(bench, Path(folder)) or _not_safe(bench)
        if found:
            wrong.append(f"{name}: {found}")
    return Row(line, len(some), "; ".join(wrong) or as_wished, not wrong)


def _name(sent: tuple[signal.Signals, ...]) -> str:
    return " ".join(number.name for number in sent)


def _not_safe(bench: Wires) -> str:
    state = bench.state()
    return "" if state == SAFE else f"left at {state}"


def _signalled(phase: str, sent: tuple[signal.Signals, ...], bench: Wires, folder: Path) -> str:
    arguments, wait = PHASES[phase]
    run = Process(bench.bench, folder, *arguments)
    wait(run)
    run.send(*sent)
    return _completed(run) if phase in AFTER else _ended(run, 4, BY[sent[0]])


def _completed(run: Process) -> str:
    """Problem in the end of a run that no signal ended: its report exists, or the manifest has the reason.

    A signal before the writing of results changes nothing.
    """
    if (code := run.code()) not in (0, 3):
        return f"{code}; {run.told.read_text('utf-8')[-300:]}"
    assert run.path is not None
    reasons = [text for text in run.manifest()["problems"] if "no report was written, because a signal arrived" in text]
    told, wanted = (bool(reasons), (run.path / "report.html").exists()), (code == 3, code == 0)
    if told != wanted or not all(reason in run.told.read_text("utf-8") for reason in reasons):
        return f"exit code {code}, problems {run.manifest()['problems']}; {run.told.read_text('utf-8')[-300:]}"
    return _ended(run, code, None)


def _ended(run: Process, code: int, by: str | None) -> str:
    """Problem in the end of a run."""
    found = run.code()
    if run.path is None:
        return f"{found} without a run; {run.told.read_text('utf-8')[-300:]}"
    manifest = run.manifest()
    told = (found, manifest["ended_by"], manifest["verdict"], manifest["unsafe"])
    wanted = (code, by, "PASS" if by is None else "ABORTED", {})
    return "" if told == wanted else f"{told} instead of {wanted}; {run.told.read_text('utf-8')[-300:]}"


def _ignored(bench: Wires, folder: Path) -> str:
    """Under nohup a hang-up ends nothing."""
    run = Process(bench.bench, folder, preexec_fn=lambda: signal.signal(HUP, signal.SIG_IGN))
    run.until_step("steps/wait")
    run.send(HUP)
    time.sleep(2)
    if run.process.poll() is not None:
        return "it ended by a signal that is ignored"
    run.send(TERM)
    return _ended(run, 4, "terminate")


def _closed(bench: Wires, folder: Path) -> str:
    """The terminal is closed: SIGHUP, and every later output is an error."""
    master, slave = os.openpty()

    def take_terminal() -> None:
        os.setsid()
        import fcntl
        import termios

        fcntl.ioctl(slave, termios.TIOCSCTTY, 0)

    run = Process(bench.bench, folder, stdin=slave, stdout=slave, stderr=slave, preexec_fn=take_terminal)
    os.close(slave)
    run.until_step("steps/wait")
    os.close(master)
    return _ended(run, 4, "hang-up")


def _hangs(bench: Wires, folder: Path) -> str:
    """Block the output: nobody reads the pipe, and it is full."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    try:
        while os.write(writing, b"x" * 4096):
            pass
    except BlockingIOError:
        os.set_blocking(writing, True)
    run = Process(bench.bench, folder, stderr=writing)
    os.close(writing)
    run.until_step("steps/wait")
    run.send(TERM)
    try:
        return _ended(run, 4, "terminate")
    finally:
        os.close(reading)


def _no_reader(bench: Wires, folder: Path) -> str:
    """Whoever read has gone: every output is an error, on both streams."""
    reading, writing = os.pipe()
    run = Process(bench.bench, folder, stdout=writing, stderr=writing)
    os.close(writing)
    run.until_step("steps/wait")
    os.close(reading)
    run.send(TERM)
    return _ended(run, 4, "terminate")

"""devices, simulate, trace, console: commands for the instruments of a bench."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from bench.cli.commands import Command, argument, arguments, flag, option, options, whole_number
from bench.cli.exits import ABORTED, BENCH_ERROR, NOT_SAFE, PASS
from bench.cli.running import BENCH, SCENARIO, SEED, SIMULATE
from bench.cli.streams import remark, say

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.app.arrival import MadeSafe
    from bench.lanes import Lane


def list_devices(bench: str | None, *, simulate: bool) -> int:
    """Connect to every instrument of a bench, identify it, and show its readings."""
    from bench.app.inspect import inspect_devices

    looks = inspect_devices(bench, simulate=simulate)
    say(*(look.line() for look in looks))
    return BENCH_ERROR if any(look.problem for look in looks) else PASS


def scan_for_devices(
    addresses: tuple[str, ...], baud: int, units: tuple[int, ...], drivers: tuple[str, ...], *, serial: bool
) -> None:
    """Find instruments with read-only queries, and propose bench file entries for them on stdout."""
    from bench.app.proposals import proposal
    from bench.app.scan import scan_here

    places = scan_here(addresses, serial=serial or None, drivers=drivers, units=units or (1,), baud=baud)
    remark(*(place.line() for place in places))
    if not places:
        remark("there is no serial port; give the addresses to scan")
    if any(place.candidates for place in places):
        sys.stdout.write(proposal(places))


def simulate(bench: str, seed: int | None, trace: Path | None, scenario: Path | None) -> None:
    """Simulate the instruments behind all loopback and pty addresses of a bench file, in real time, until Ctrl-C."""
    from bench.app.serve import serve_bench

    serve_bench(bench, seed, remark, trace, scenario)


def trace(out: Path, bench: str | None, for_s: float, *, simulate: bool) -> int:
    """Read every instrument of a bench for a given time, and record every byte on the wires."""
    from bench.app.tracing import trace_bench

    lines, problems = trace_bench(bench, out, for_s, simulate=simulate)
    say(f"{lines} lines in {out}")
    remark(*dict.fromkeys(problems))
    return BENCH_ERROR if problems else PASS


def console(device: str, bench: str | None, *, simulate: bool, write: bool) -> int:
    """Communicate with one instrument by hand: in its own protocol, and through its driver (:help)."""
    from bench.app.console import talk
    from bench.runner.terminal import typed_lines

    return BENCH_ERROR if talk(device, bench, typed_lines, say, simulate=simulate, write=write) else PASS


def make_safe(bench: str | None, *, if_left_on: bool, wait: bool) -> int:
    """Make every instrument of a bench safe now, also while a run holds it, or with some instruments missing.

    Without --bench: all benches that a run may have left on.

    A chamber is safe when its safe set point is commanded; its air arrives later. The command prints the air
    temperature, and with --wait stays until the air has arrived. Ctrl-C ends the wait (exit code 4) and leaves the
    chambers as commanded. A chamber that has not arrived in the time that its bench file allows gives exit code 6.
    """
    from bench.app.arrival import report_arrivals
    from bench.app.make_safe import make_safe as made_safe

    def show(lane: Lane) -> None:
        air = "" if lane.air_c is None or lane.why else f"commanded; its air is at {lane.air_c:.1f} °C"
        say(f"{lane.role:<16} {lane.state:<12} {lane.took_s:6.1f} s  {lane.why}{air}".rstrip())

    made: list[MadeSafe] = []
    lanes = list(made_safe(bench, remark, show, made.append, if_left_on=if_left_on))
    left = [lane.role for lane in lanes if lane.state != "safe"]
    if left:
        remark(f"NOT MADE SAFE: {', '.join(left)}. Switch them off by hand, then try again.")
    arrivals = report_arrivals(made, remark, wait=wait)
    if left or not arrivals.good:
        return NOT_SAFE
    return ABORTED if arrivals.ended else PASS


def lockout(bench: str | None, reason: str, by: str, *, lift: bool) -> int:
    """Lock a bench out while a person works at it: it is switched off and stopped, and no run starts.

    Without --bench: list the benches that are locked out.
    """
    import getpass

    from bench.app.lockout import lift_lockout, listed, set_lockout

    if bench is None:
        say(*listed())
        return PASS
    signed = by or getpass.getuser(), reason
    if lift:
        lift_lockout(bench, *signed)
        return PASS
    set_lockout(bench, *signed)
    return make_safe(bench, if_left_on=False, wait=False)


def _seconds(text: str) -> float:
    number = float(text)
    if not number >= 0:
        raise ValueError(text)
    return number


COMMANDS = (
    Command("devices", list_devices, (BENCH, SIMULATE)),
    Command("devices list", list_devices, (BENCH, SIMULATE)),
    Command("devices scan", scan_for_devices, (
        arguments(
            "ADDRESS", "An address as in a bench file, HOST:PORT, or the path of a serial port.",
            to="addresses", least=0
        ),
        flag("--serial", "Scan all serial ports too; the default without an address."),
        option(
            "--baud BAUD", "Try only this baud rate; 0: those that the drivers name.", read=whole_number(0), default=0
        ),
        options(
            "--unit NUMBER", "A Modbus or CTS address on a shared line; repeatable.", to="units",
            read=whole_number(1, 247),
        ),
        options("--driver NAME", "Try only this driver; repeatable.", to="drivers"),
    )),
    Command("make-safe", make_safe, (
        option("--bench FILE", "The bench; default: every bench that a run may have left on."),
        flag("--if-left-on", "Only benches that a run which is over may have left on."),
        flag("--wait", "Wait until the air of every chamber has arrived, and show its temperature."),
    )),
    Command("lockout", lockout, (
        option("--bench FILE", "The bench; default: list the benches that are locked out."),
        option("--reason TEXT", "What is done at the bench; or, with --lift, that it is done.", default=""),
        option("--by NAME", "Who works there; default: $USER.", default=""),
        flag("--lift", "Lift the lockout."),
    )),
    Command("simulate", simulate, (
        option("--bench FILE", "The bench whose instruments to simulate.", is_required=True),
        SEED,
        option("--trace FILE", "Replay the instruments recorded in this trace.", read=Path),
        SCENARIO,
    )),
    Command("trace", trace, (
        option("--out FILE", "The trace file to create.", read=Path, is_required=True),
        BENCH,
        SIMULATE,
        option("--for SECONDS", "How long to record.", to="for_s", read=_seconds, default=10.0),
    )),
    Command("console", console, (
        argument("DEVICE", "The name of a device in the bench file."),
        BENCH,
        SIMULATE,
        flag("--write", "Also send commands that may change the instrument's state."),
    )),
)  # fmt: skip

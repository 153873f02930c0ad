"""devices, simulate, trace, console: what is done with the instruments of a bench."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.exits import BENCH_ERROR
from bench.cli.running import BenchOption, Scenario, Simulate

group = typer.Typer(
    help="List the instruments of a bench, or find new ones.", invoke_without_command=True, rich_markup_mode=None
)


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.add_typer(group, name="devices")
    app.command()(simulate)
    app.command()(trace)
    app.command()(console)


@group.callback()
def devices_of(context: typer.Context, bench: BenchOption = None, simulate: Simulate = False) -> None:
    """Connect to every instrument of a bench, identify it, and show its readings."""
    if context.invoked_subcommand is None:
        list_devices(bench, simulate)


@group.command("list")
def list_devices(bench: BenchOption = None, simulate: Simulate = False) -> None:
    """Connect to every instrument of a bench, identify it, and show its readings."""
    from bench.app.inspect import look_at_devices

    looks = look_at_devices(bench, simulate=simulate)
    for look in looks:
        sys.stdout.write(look.line() + "\n")
    if any(look.problem for look in looks):
        raise typer.Exit(BENCH_ERROR)


@group.command("scan")
def scan_for_devices(
    addresses: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="ADDRESS...", help="An address as in a bench file, HOST:PORT, or the path of a serial port."
        ),
    ] = None,
    serial: Annotated[
        bool | None,
        typer.Option("--serial/--no-serial", help="Scan all serial ports; the default without an address."),
    ] = None,
    baud: Annotated[int, typer.Option(min=0, help="Try only this baud rate; 0: those that the drivers name.")] = 0,
    unit: Annotated[
        list[int] | None, typer.Option(min=1, max=247, help="A Modbus or CTS address on a shared line; repeatable.")
    ] = None,
    driver: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Try only this driver; repeatable.")] = None,
) -> None:
    """Find instruments by queries that change nothing, and propose bench file entries for them on stdout."""
    from bench.app.proposals import proposal
    from bench.app.scan import scan_here

    places = scan_here(addresses or (), serial=serial, drivers=driver or (), units=unit or (1,), baud=baud)
    for place in places:
        sys.stderr.write(place.line() + "\n")
    if not places:
        sys.stderr.write("there is no serial port; give the addresses to scan\n")
    if any(place.candidates for place in places):
        sys.stdout.write(proposal(places))


def simulate(
    bench: Annotated[str, typer.Option("--bench", metavar="FILE", help="The bench whose instruments to simulate.")],
    seed: Annotated[int | None, typer.Option(help="Seed of the simulation.")] = None,
    trace: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Replay the instruments recorded in this trace.")
    ] = None,
    scenario: Scenario = None,
) -> None:
    """Serve the other end of every loopback and pty address of a bench file, in real time, until Ctrl-C."""
    from bench.app.serve import serve_bench

    serve_bench(bench, seed, lambda line: sys.stderr.write(line + "\n"), trace, scenario)


def trace(
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The trace file to create.")],
    bench: BenchOption = None,
    simulate: Simulate = False,
    for_s: Annotated[float, typer.Option("--for", metavar="SECONDS", min=0, help="How long to record.")] = 10.0,
) -> None:
    """Read every instrument of a bench for a while, and record every byte on the wires."""
    from bench.app.tracing import trace_bench

    lines, problems = trace_bench(bench, out, for_s, simulate=simulate)
    sys.stdout.write(f"{lines} lines in {out}\n")
    for problem in dict.fromkeys(problems):
        sys.stderr.write(f"{problem}\n")
    if problems:
        raise typer.Exit(BENCH_ERROR)


def console(
    device: Annotated[str, typer.Argument(metavar="DEVICE", help="The name of a device in the bench file.")],
    bench: BenchOption = None,
    simulate: Simulate = False,
    write: Annotated[
        bool, typer.Option("--write/--read-only", help="Also send commands that may change the instrument's state.")
    ] = False,
) -> None:
    """Talk to one instrument by hand: in its own language, and through its driver (:help)."""
    from bench.app.console import talk
    from bench.runner.terminal import typed_lines

    def say(text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    if talk(device, bench, typed_lines, say, simulate=simulate, write=write):
        raise typer.Exit(BENCH_ERROR)

"""`bench simulate`: simulated instruments at every local address of a bench file, in real time."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path

from bench.app.faults import BEGINS, FaultPlayer
from bench.app.laboratory import Laboratory, make_laboratory, unit_files
from bench.app.request import load_bench_named
from bench.app.scenario import with_scenario
from bench.app.tracing import read_trace_file
from bench.config.models import BenchFile
from bench.config.simulation import FaultSimulation
from bench.errors import BenchError, InputError
from bench.loop import REAL_TIME
from bench.loop import run as run_loop
from drivers.transport.address import Address
from simulators.instruments.can_nodes.slcan_adapter import SimulatedAdapter
from simulators.instruments.can_nodes.socketcand_server import SimulatedServer
from simulators.serving.pty import serve_pty
from simulators.serving.replay import ReplayedInstrument


def serve_bench(
    name: str, seed: int | None, say: Callable[[str], object], trace: Path | None = None, scenario: Path | None = None
) -> None:
    """Serve until SIGINT or SIGTERM; `say` receives a line for each served address, then `ready`.

    Devices recorded in a `trace` replay it. Faults of the bench file and of a `scenario` are injected from then on,
    each with a line when it begins and ends. Raises InputError if the file has no local address, BenchError if one is
    taken.
    """
    loaded, _ = with_scenario(load_bench_named(name), scenario, None)
    bench = loaded.bench
    units = unit_files(bench, None)
    if not any(entry.connection.is_local for entry in bench.devices.values()):
        raise InputError(f"{name}: no device has a loopback address or a pty, so there is nothing to serve")

    recorded = [] if trace is None else read_trace_file(trace)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        laboratory = make_laboratory(bench, units, bench.simulation.seed if seed is None else seed, loop.time)
        for role in {passed.device for passed in recorded} & laboratory.instruments.keys():
            laboratory.instruments[role] = ReplayedInstrument(role, recorded, say)
        stopped = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stopped.set)
        async with AsyncExitStack() as stack:
            for line in await open_servers(bench, laboratory, stack):
                say(line)
            say("ready")
            FaultPlayer(laboratory, bench.simulation.faults, lambda kind, fault: say(_show_fault(kind, fault)))
            await stopped.wait()

    run_loop(main(), REAL_TIME)


def _show_fault(kind: str, fault: FaultSimulation) -> str:
    return f"{fault.victim} {fault.kind} {'begins' if kind == BEGINS else 'ends'}"


async def open_servers(bench: BenchFile, laboratory: Laboratory, stack: AsyncExitStack) -> list[str]:
    """Serve every local address of a bench until `stack` closes; return a line for each. Raises BenchError."""
    lines = []
    for role, entry in bench.devices.items():
        if entry.connection.is_person:
            lines.append(
                f"{role:<10} {entry.driver:<18} {entry.connection} has no connection that can be served; it "
                "is not simulated here"
            )
        if not entry.connection.is_local:
            continue
        try:
            await _serve(role, entry.connection, laboratory, stack)
        except OSError as problem:
            raise BenchError(
                f"{role}: {entry.connection} cannot be served ({problem}); is another simulation running?"
            ) from problem
        lines.append(f"{role:<10} {entry.driver:<18} {entry.connection}")
    return lines


async def _serve(role: str, address: Address, laboratory: Laboratory, stack: AsyncExitStack) -> None:
    loop = asyncio.get_running_loop()
    if role in laboratory.nodes:
        node = laboratory.nodes[role]
        if address.scheme == "socketcand":
            made = partial(SimulatedServer, node, address.path)
            await stack.enter_async_context(await loop.create_server(made, address.host, address.port))
            return
        await stack.enter_async_context(serve_pty(Path(address.path), lambda: SimulatedAdapter(node)))
        return
    factory = laboratory.end_of_line(role)
    if address.scheme == "serial":
        await stack.enter_async_context(serve_pty(Path(address.path), factory))
        return
    server = await loop.create_server(factory, address.host, address.port)
    await stack.enter_async_context(server)

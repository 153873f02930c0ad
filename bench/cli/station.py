"""serve, attempt: the station and the processes of its runs."""

from __future__ import annotations

from pathlib import Path

from bench.cli.commands import Command, argument, flag, option, options, whole_number
from bench.cli.streams import say


def serve(
    file: Path | None,
    bench: str | None,
    runs: Path | None,
    folder: Path | None,
    host: str,
    port: int,
    hosts: tuple[str, ...],
    certificate: Path | None,
    key: Path | None,
    launch: str | None,
    *,
    insecure: bool,
) -> None:
    """Serve a station: the queue of its benches, the API and the pages. Runs go on when it ends."""
    import asyncio

    from bench.errors import InputError
    from bench.runner.output import tolerant_output
    from bench.station.settings import bench_name, read_station

    try:
        from bench.web.listening import Listening
        from bench.web.server import serve as served
    except ImportError as problem:
        raise InputError(
            f"'bench serve' needs more packages ({problem}): pip install 'inertial-test-bench[station]'"
        ) from None
    if launch not in (None, "process", "service"):
        raise InputError(f"--launch {launch}: give process or service")
    named = {bench_name(bench): bench} if bench else None
    settings = read_station(file, folder, benches=named, runs=runs, launch=launch)

    with tolerant_output():
        asyncio.run(served(settings, Listening(host, port, certificate, key, hosts, insecure), say))


def attempt(folder: Path) -> None:
    """Make the attempt at a run that a station has prepared in a folder; the station calls this."""
    from bench.station.queue.attempts import make

    make(folder)


def overview(
    broker: str,
    password_file: Path | None,
    ca: Path | None,
    client_certificate: Path | None,
    client_key: Path | None,
    archive: str | None,
    title: str,
    zone: str,
    folder: Path | None,
    host: str,
    port: int,
    hosts: tuple[str, ...],
    certificate: Path | None,
    key: Path | None,
    *,
    insecure: bool,
) -> None:
    """Serve one page for the benches of all stations that publish to a broker (MQTT).

    It only reads: it publishes nothing and commands nothing. A password of the broker is in a file or in the variable
    BENCH_BROKER_PASSWORD. With --archive, the history of benches and units is read there.
    """
    import asyncio
    import os

    from bench.errors import InputError
    from bench.runner.output import tolerant_output

    try:
        from bench.overview.broker import PASSWORD_VARIABLE, BrokerFiles, address_of
        from bench.overview.server import Wanted
        from bench.overview.server import serve as served
        from bench.web.listening import Listening
    except ImportError as problem:
        raise InputError(
            f"'bench station' needs more packages ({problem}): pip install 'inertial-test-bench[station]'"
        ) from None
    files = BrokerFiles(password_file, ca, client_certificate, client_key)
    address = address_of(broker, files, os.environ.get(PASSWORD_VARIABLE, ""))
    wanted = Wanted(address, archive or "", title, zone, folder)
    with tolerant_output():
        asyncio.run(served(wanted, Listening(host, port, certificate, key, hosts, insecure), say))


_LISTENING = (
    options("--name HOST", "A further host name by which it is reached; repeatable.", to="hosts"),
    option("--certificate FILE", "Certificate for TLS.", read=Path),
    option("--key FILE", "Key of the certificate.", read=Path),
    flag("--insecure", "Serve a network without users or TLS; all pages show a banner."),
)
COMMANDS = (
    Command("serve", serve, (
        argument("FILE", "Settings of the station; without it the shipped simulated bench.", read=Path, default=None),
        option("--bench FILE", "The bench of the station, in place of those of the settings."),
        option("--runs DIR", "Directory of the runs; default: that of the settings, or runs.", read=Path),
        option("--folder DIR", "Folder of the station's own records.", read=Path),
        option("--host ADDRESS", "Address to listen at.", default="127.0.0.1"),
        option("--port N", "Port to listen at; 0 for a free one.", read=whole_number(0, 65535), default=8421),
        option("--launch WAY", "How a run starts: process, or service of systemd; default: that of the settings."),
        *_LISTENING,
    )),
    Command("station", overview, (
        option(
            "--broker URL", "The broker: mqtt://HOST, mqtts://USER@HOST:PORT.", variable="BENCH_BROKER",
            is_required=True,
        ),
        option("--password-file FILE", "File of the password at the broker, of mode 0600.", read=Path),
        option("--ca FILE", "Certificates that the broker is verified by; default: those of the system.", read=Path),
        option("--client-certificate FILE", "Certificate of this client for the broker.", read=Path),
        option("--client-key FILE", "Key of that certificate, of mode 0600.", read=Path),
        option(
            "--archive DEST", "Archive of runs for the history; needs the extra 'archive'.", variable="BENCH_ARCHIVE"
        ),
        option("--title TEXT", "Name on pages.", default=""),
        option("--zone ZONE", "Time zone of the page, such as Europe/Berlin; default: that of this computer.",
               default=""),
        option("--folder DIR", "Folder of its users and sessions.", read=Path),
        option("--host ADDRESS", "Address to listen at.", default="127.0.0.1"),
        option("--port N", "Port to listen at; 0 for a free one.", read=whole_number(0, 65535), default=8422),
        *_LISTENING,
    )),
    Command("attempt", attempt, (argument("FOLDER", "Folder of the attempt.", read=Path),)),
)  # fmt: skip

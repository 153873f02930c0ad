"""Server of a station: the daemon and its HTTP interface in one process and one event loop."""

from __future__ import annotations

import sys
from collections.abc import Callable

from bench.client.address import TOKEN
from bench.runner.notify import notify
from bench.station.daemon import Daemon, at_work
from bench.station.log import Log, libraries_in, make_log
from bench.station.mqtt.part import Mqtt
from bench.station.part import Part
from bench.station.settings import Settings
from bench.station.storage.audit import Audit
from bench.web.ahead import Ahead
from bench.web.app import make_app
from bench.web.identity import Identity
from bench.web.listening import (
    Listening,
    address_for_others,
    banner_of,
    expect_safe,
    expect_secret,
    listening_at,
    own_host,
    server_of,
    until_signal,
)
from bench.web.sentence import doing
from bench.web.services import Services


async def serve(settings: Settings, listening: Listening, say: Callable[[str], object]) -> None:
    """Serve until SIGINT or SIGTERM; runs go on. `say` writes to the terminal, and to no log.

    Raises InputError for an address that is not allowed, InUseError if another station has the folder, StoreError.
    """
    log = make_log(sys.stderr)
    with libraries_in(log):
        await _serve(settings, listening, say, log)


async def _serve(settings: Settings, listening: Listening, say: Callable[[str], object], log: Log) -> None:
    async with at_work(settings, more=_more, log=log) as daemon:
        identity = Identity(daemon.database, settings.idle)
        expect_safe(listening, identity)
        expect_secret(settings.folder / TOKEN, listening.key)
        services = Services(daemon, identity, Audit(daemon.database), banner_of(listening, identity))
        hosts = (*listening.hosts, *own_host(listening))
        app = make_app(services, hosts, secure=listening.certificate is not None, log=log)
        with listening_at(
            listening, identity, settings.folder, settings.runs, settings.title, say
        ) as (listener, url):  # fmt: skip
            daemon.address = address_for_others(listening, url)
            notify("READY=1", f"STATUS=serves {url}")
            log.info("station begins", url=url, benches=list(settings.benches))
            try:
                await until_signal(server_of(app, listening), listener)
            finally:
                log.info("station ends")


def _more(daemon: Daemon) -> dict[str, Part]:
    """Return the parts of a station that serves pages, and those that the settings ask for."""
    mqtt = {"MQTT": Mqtt(daemon, daemon.settings.mqtt, doing)} if daemon.settings.mqtt is not None else {}
    return {"work ahead": Ahead(daemon), **mqtt}

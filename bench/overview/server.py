"""Server of the pages of all benches: the subscription to the broker and its pages in one process."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple
from zoneinfo import available_timezones

from bench.client.address import TOKEN
from bench.errors import InputError
from bench.overview import pages
from bench.overview.board import Boards
from bench.overview.broker import Address, Subscription
from bench.overview.fold import Overview
from bench.overview.history import History
from bench.overview.site import AllBenches
from bench.runner.notify import notify
from bench.station.log import Log, libraries_in, make_log
from bench.station.storage.audit import Audit
from bench.station.storage.database import Database
from bench.station.storage.snapshots import Snapshots
from bench.store.user_state import state_folder
from bench.web.api import people
from bench.web.app import application, guarded
from bench.web.identity import Identity
from bench.web.listening import (
    Listening,
    banner_of,
    expect_safe,
    expect_secret,
    listening_at,
    own_host,
    server_of,
    until_signal,
)
from bench.web.pages import entrance, files

FOLDER = "overview"  # below the folder of the user's state
ROUTERS = (files.router, entrance.router, pages.router, people.router)


class Wanted(NamedTuple):
    """What the pages are to show: broker, archive or "", title or "", time zone or "", and the folder of users."""

    broker: Address
    archive: str = ""
    title: str = ""
    zone: str = ""
    folder: Path | None = None


async def serve(wanted: Wanted, listening: Listening, say: Callable[[str], object]) -> None:
    """Serve until SIGINT or SIGTERM. `say` writes to the terminal.

    Raises InputError for an address that is not allowed, InUseError if another process has the folder, StoreError.
    """
    zone = zone_of(wanted.zone)
    log = make_log(sys.stderr)
    history = History(wanted.archive) if wanted.archive else None
    folder = (wanted.folder or state_folder() / FOLDER).absolute()
    with libraries_in(log), closing(Database(folder)) as database:
        identity = Identity(database)
        expect_safe(listening, identity)
        expect_secret(folder / TOKEN, listening.key)
        overview = Overview()
        subscription = Subscription(wanted.broker, overview)
        boards = Boards(overview, subscription, zone)
        banner = banner_of(listening, identity)
        site = AllBenches(boards, subscription, identity, Audit(database), wanted.title, zone, banner, history)
        works = [asyncio.create_task(each) for each in (subscription.work(), Snapshots(database).work())]
        try:
            await _until_end(site, listening, folder, log, say, works)
        finally:
            for each in works:
                each.cancel()
            await asyncio.gather(*works, return_exceptions=True)
            if history is not None:
                history.close()


async def _until_end(
    site: AllBenches, listening: Listening, folder: Path, log: Log, say: Callable[[str], object],
    works: list[asyncio.Task[None]],
) -> None:  # fmt: skip
    """Serve until a signal; an error of the works ends it."""
    app = application("Inertial test bench: all benches", site, ROUTERS)
    hosts = (*listening.hosts, *own_host(listening))
    secured = guarded(app, site, hosts, secure=listening.certificate is not None, log=log)
    with listening_at(listening, site.identity, folder, folder, site.title, say) as (listener, url):
        say(f"broker {site.subscription.address.url}")
        notify("READY=1", f"STATUS=serves {url}")
        log.info("overview begins", url=url, broker=site.subscription.address.url)
        serving = asyncio.create_task(until_signal(server_of(secured, listening), listener))
        done, _ = await asyncio.wait([serving, *works], return_when=asyncio.FIRST_COMPLETED)
        if serving not in done:
            serving.cancel()
            with suppress(asyncio.CancelledError):
                await serving
        for each in done:
            each.result()
        log.info("overview ends")


def zone_of(wanted: str) -> str:
    """Return a time zone by its name; "" is that of this computer. Raises InputError for one that is not known."""
    known = available_timezones()
    if wanted and wanted not in known:
        raise InputError(f"--zone {wanted}: is not known; give one such as Europe/Berlin")
    return next((each for each in (wanted, os.environ.get("TZ", ""), _zone_of_this_computer()) if each in known), "UTC")


def _zone_of_this_computer() -> str:
    with suppress(OSError):
        return os.readlink("/etc/localtime").rpartition("zoneinfo/")[2]
    return ""

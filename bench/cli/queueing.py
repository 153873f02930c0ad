"""submit, queue, watch: runs in the queue of a station."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any

from bench.cli.commands import Command, argument, flag, option, options, whole_number
from bench.cli.exits import ABORTED, BENCH_ERROR, INPUT_ERROR, NOT_SAFE, OF_VERDICT
from bench.cli.streams import remark, say, say_json
from bench.cli.through import station_here
from bench.errors import InputError

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.client import Station

HEADER = ("item", "state", "bench", "what", "priority", "begins", "ends", "by", "why")
ITEM = argument("ITEM", "The number of an item, or the first characters of its id.")


def submit(
    sequence: str, bench: str | None, settings: tuple[str, ...], units: tuple[str, ...], *, hold: bool, wait: bool,
    as_json: bool, **submission: Any,
) -> int | None:  # fmt: skip
    """Submit a run to the queue of the station; it is checked first."""
    station = running_station()
    given = {name: value for name, value in submission.items() if value not in (None, "", False)}
    item = station.submit(
        sequence, bench or _only_bench(station), held=hold, settings=_pairs(settings, "--set"),
        units=_pairs(units, "--uut", "a"), **given,
    )  # fmt: skip
    if not wait:
        if as_json:
            say_json(item)
        else:
            say(_submitted(station, item))
        return None
    remark(_submitted(station, item))
    return _waited(station, item, as_json=as_json)


def running_station() -> Station:
    """Return the station of this user. Raises InputError, which says how to start one."""
    if (station := station_here()) is not None:
        return station
    from bench.client.station import HOW_TO_START

    raise InputError(HOW_TO_START)


def _only_bench(station: Station) -> str:
    names = [str(each["name"]) for each in station.state()["benches"]]
    if len(names) != 1:
        raise InputError(f"the station has several benches; give one: --bench {'|'.join(names)}")
    return names[0]


def _pairs(texts: tuple[str, ...], of: str, without: str = "") -> dict[str, str]:
    """Return NAME=VALUE words as a mapping; `without` is the name of a value alone. Raises InputError."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        name = name if equals else without
        if not name or name in found:
            raise InputError(f"{of} {text}: " + ("is given twice" if name else "write NAME=VALUE"))
        found[name] = value if equals else text
    return found


def _submitted(station: Station, item: dict[str, Any]) -> str:
    seen = next((each for each in station.queue() if each["item"]["id"] == item["id"]), None)
    begins = _clock(seen["begins"]) if seen is not None else ""
    return f"item {item['number']} is {item['state']} at bench {item['submission']['bench']}" + (
        f"; begins about {begins}, ends about {_clock(seen['ends'])}" if seen is not None and begins else ""
    )


def _waited(station: Station, item: dict[str, Any], *, as_json: bool) -> int:
    """Wait until an item has ended; return the exit code of its run."""
    last = ""

    def seen(found: dict[str, Any]) -> None:
        nonlocal last
        text = f"item {found['number']} is {found['state']}" + (f": {found['reason']}" if found["reason"] else "")
        if text != last:
            remark(text)
            last = text

    try:
        ended = station.wait(item["id"], seen=seen)
    except KeyboardInterrupt:
        remark(f"item {item['number']} stays in the queue: bench queue")
        return ABORTED
    if as_json:
        say_json(ended)
    elif ended["run"]:
        say(f"{ended['run']}: {ended['outcome']}, {ended['verdict'] or 'no verdict'}")
    return code_of(ended)


def code_of(item: dict[str, Any]) -> int:
    """Return the exit code of the run of an item that has ended."""
    if item["state"] == "refused":
        return INPUT_ERROR
    if item["state"] == "cancelled":
        return ABORTED
    return NOT_SAFE if item["reason"] else OF_VERDICT.get(item["verdict"], BENCH_ERROR)


def queue(*, past: bool, as_json: bool) -> None:
    """List the items that run or wait, in the order in which they begin."""
    from bench.figures.columns import in_columns

    station = running_station()
    found = station.queue(past=past)
    if as_json:
        say_json(found)
        return
    say(*in_columns([HEADER, *map(_row, found)], "<<<<><<<<", indent="") if found else ["no item waits"])
    for bench in station.state()["benches"]:
        if bench["stopped"]:
            name = bench["name"]
            say(f"\nbench {name} has stopped: {bench['stopped']}", f"look at it, then: bench queue go-on {name}")


def _row(each: dict[str, Any]) -> tuple[str, ...]:
    item, wanted = each["item"], each["item"]["submission"]
    return (
        str(item["number"]), item["state"], wanted["bench"], " ".join([wanted["sequence"], *wanted["units"].values()]),
        str(item["priority"]), _clock(each["begins"]), _clock(each["ends"]), item["submitted_by"],
        item["verdict"] or (item["reason"].splitlines() or [""])[0],
    )  # fmt: skip


def _clock(text: str | None) -> str:
    """Return an instant by the clock of this computer, with its date if it is not today."""
    from bench.clock import wall_utc

    if not text:
        return ""
    at = datetime.fromisoformat(text).astimezone()
    return f"{at:%H:%M}" if at.date() == wall_utc().astimezone().date() else f"{at:%Y-%m-%d %H:%M}"


def _item(station: Station, word: str) -> dict[str, Any]:
    """Return the item of a number, or of the beginning of an id. Raises InputError."""
    items = [each["item"] for each in station.queue(past=True)]
    found = [each for each in items if str(each["number"]) == word.removeprefix("#")]
    found = found or [each for each in items if len(word) >= 6 and each["id"].startswith(word)]
    if len(found) != 1:
        raise InputError(f"'{word}' is {'several items' if found else 'no item'}; 'bench queue --past' lists all")
    return dict(found[0])


def hold(item: str) -> None:
    """Hold a waiting item until it is released."""
    _changed(item, "hold")


def release(item: str) -> None:
    """Release a held item."""
    _changed(item, "release")


def cancel(item: str) -> None:
    """Cancel a waiting item."""
    _changed(item, "cancel")


def _changed(word: str, change: str) -> None:
    """Change an item in the state in which it is found now."""
    station = running_station()
    found = _item(station, word)
    _say(getattr(station, change)(found["id"], found["version"]))


def move(item: str, before: str | None) -> None:
    """Move a waiting item before another one, with its priority, or to the end."""
    station = running_station()
    found = _item(station, item)
    _say(station.move(found["id"], _item(station, before)["id"] if before else None, found["version"]))


def clone(item: str) -> None:
    """Append an item with the submission of another one."""
    station = running_station()
    _say(station.clone(_item(station, item)["id"]))


def go_on(bench: str) -> None:
    """Let items begin again at a bench that has stopped, after somebody has looked at it."""
    running_station().go_on(bench)
    say(f"bench {bench}: items begin again")


def _say(item: dict[str, Any]) -> None:
    say(f"item {item['number']} is {item['state']}, priority {item['priority']}")


_JSON = flag("--json", "Print only JSON on stdout.", to="as_json")
_LIST = (flag("--past", "Also those that have ended."), _JSON)
COMMANDS = (
    Command("submit", submit, (
        argument("SEQUENCE", "A sequence of the station, by its name."),
        option("--bench NAME", "A bench of the station; may be left out if there is one."),
        option("--preset PRESET", "A preset of the sequence."),
        options("--set NAME=VALUE", "A parameter of the sequence; repeatable.", to="settings"),
        options("--uut [PLACE=]SERIAL", "Serial number of the unit under test; one for each place.", to="units"),
        option("--operator NAME", "Who runs it; default: who submits it."),
        option("--order TEXT", "The order that the run is for; shown in the report."),
        option("--procedure TEXT", "The test procedure and its revision; shown in the report."),
        option("--priority N", "From -9 to 9; higher ones begin first.", read=int),
        option("--not-before INSTANT", "It begins at this instant or later, such as 2026-01-31T07:00Z."),
        flag("--hold", "It waits until it is released."),
        flag("--unattended", "It begins only if every line of the preflight is good."),
        option("--past-due refuse|mark", "If a calibration is past due.", choices=("refuse", "mark")),
        option("--speed max|N", "Bench seconds per real second, on a simulated bench."),
        option("--seed SEED", "Seed of the simulation.", read=whole_number(0)),
        flag("--wait", "Wait for the end; the exit code is that of the run."),
        _JSON,
    )),
    Command("queue", queue, _LIST),
    Command("queue list", queue, _LIST),
    Command("queue hold", hold, (ITEM,)),
    Command("queue release", release, (ITEM,)),
    Command("queue move", move, (ITEM, option("--before ITEM", "The item that it is to precede; default: the end."))),
    Command("queue cancel", cancel, (ITEM,)),
    Command("queue clone", clone, (ITEM,)),
    Command("queue go-on", go_on, (argument("BENCH", "A bench of the station."),)),
)  # fmt: skip

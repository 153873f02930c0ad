"""Two operators: who works at a bench is seen by all, commands its runs alone, and holds nobody up for long."""

from __future__ import annotations

import pytest

from bench.station.leases import LASTS_S, LeasedError, Leases
from tests.support.web import with_station


def test_a_lease_ends_by_itself_unless_it_is_renewed():
    now_s = [0.0]
    leases = Leases(lambda: now_s[0])
    leases.take("a", "anna", "tuning")
    for _ in range(5):
        now_s[0] += LASTS_S - 1
        leases.take("a", "anna", "tuning")
        with pytest.raises(LeasedError, match="anna works at bench 'a'"):
            leases.take("a", "ben")
    leases.expect("b", "ben")
    now_s[0] += LASTS_S
    leases.expect("a", "ben")
    assert leases.take("a", "ben").holder == "ben"


def test_only_the_holder_commands_and_everybody_may_make_safe(tmp_path):
    async def act(here):
        here.add_users()
        run, lease = f"/api/v1/runs/{here.run.path.name}", "/api/v1/benches/demo/lease"
        operator, engineer = here.session("operator"), here.session("engineer")
        taken = await here.ask("PUT", lease, cookie=engineer, content={"note": "tuning"})
        assert (taken.status, taken.json()["holder"]) == (200, "engineer")
        seen = (await here.ask("GET", "/api/v1/station", cookie=operator)).json()["benches"][0]["lease"]
        assert (seen["holder"], seen["note"]) == ("engineer", "tuning")
        for command in ("resume", "skip", "repeat", "answer"):
            content = {"answer": "yes"} if command == "answer" else None
            refused = await here.ask("POST", f"{run}/{command}", cookie=operator, content=content)
            assert (refused.status, "engineer works at" in refused.json()["detail"]) == (409, True)
            assert (await here.ask("POST", f"{run}/{command}", cookie=engineer, content=content)).status == 200
        here.heard.clear()
        for command in ("pause", "stop", "abort"):
            assert (await here.ask("POST", f"{run}/{command}", cookie=operator)).status == 200
        assert [by for _, by in here.heard] == ["operator"] * 3
        assert (await here.ask("PUT", lease, cookie=operator, content={})).status == 409
        assert (await here.ask("DELETE", lease, cookie=operator)).status == 409
        assert (await here.ask("POST", f"{lease}/take-over", cookie=operator, content={})).status == 403

    with_station(tmp_path, act)


def test_an_engineer_takes_over_and_all_of_it_is_in_the_audit(tmp_path):
    async def act(here):
        here.add_users()
        lease = "/api/v1/benches/demo/lease"
        operator, engineer = here.session("operator"), here.session("engineer")
        for _ in range(3):
            await here.ask("PUT", lease, cookie=operator, content={})
        over = await here.ask("POST", f"{lease}/take-over", cookie=engineer, content={"note": "smoke"})
        assert over.json()["holder"] == "engineer"
        assert (await here.ask("PUT", lease, cookie=operator, content={})).status == 409
        assert (await here.ask("DELETE", lease, cookie=engineer)).status == 204
        assert (await here.ask("PUT", lease, cookie=operator, content={})).status == 200
        entries = list(here.audit.entries())
        assert [each["action"] for each in entries] == [
            "take lease", "take over lease", "give lease back", "take lease"
        ]  # fmt: skip
        assert (entries[1]["before"], entries[1]["after"], entries[1]["reason"]) == ("operator", "engineer", "smoke")
        assert (await here.ask("PUT", "/api/v1/benches/other/lease", cookie=operator, content={})).status == 422

    with_station(tmp_path, act)

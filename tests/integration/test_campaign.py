"""Campaigns by processes of this computer: killed workers, resumption, and what a worker must not do."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bench.archive.destination import Destination
from bench.archive.publish import push
from bench.campaign import carry_out as order
from bench.campaign.carry_out import carry_out
from bench.campaign.cluster import KILLS, here
from bench.campaign.ledger import opened
from bench.campaign.program import digest_of, identity
from bench.campaign.reductions import Reductions
from bench.errors import InputError
from bench.store.user_state import state_folder
from tests.support.campaign_tasks import Given, lines_in, squares, task, workers_under
from tests.support.runs import ROOT, run_short

pytestmark = [
    pytest.mark.integration, pytest.mark.slow, pytest.mark.timeout(400),
    pytest.mark.leaves("threads of dask.distributed, which it keeps for the next client"),
]  # fmt: skip
BENCH = [sys.executable, "-m", "bench", "campaign"]


@pytest.fixture(scope="module")
def client():
    """Two workers of this computer."""
    with here(2) as found:
        yield found


def carried_out(folder, tasks, client, **options):
    """The results of tasks, by key, and the second ones that differ."""
    with opened(folder, digest_of(identity())) as ledger:
        carry_out(Given(tasks), ledger, client, lambda _: None, **options)
        return {each.key: ledger.known(each) for each in tasks}, ledger.differing(tasks)


def test_every_task_is_done_once_and_not_again_by_the_next_campaign(tmp_path, client):
    tasks = squares(500)
    found, _ = carried_out(tmp_path, tasks, client)
    assert [found[each.key].content["square"] for each in tasks] == [number**2 for number in range(500)]
    assert len(lines_in(tmp_path)) == 500
    assert len({each.worker for each in lines_in(tmp_path)}) == 2
    again, _ = carried_out(tmp_path, [*tasks, task("worker")], client)
    assert again.items() >= found.items()
    assert len(lines_in(tmp_path)) == 501


def test_a_task_that_kills_its_workers_fails_and_the_others_are_done(tmp_path, client):
    found, _ = carried_out(tmp_path, [*squares(20), task("killed"), *squares(20, after_s=0.01)], client)
    problem = found["killed"].problem
    assert f"{KILLS} workers were killed" in problem
    assert [key for key, result in found.items() if not result.is_finished] == ["killed"]


def test_a_task_whose_worker_is_killed_is_done_by_another(tmp_path, client):
    found, _ = carried_out(tmp_path, [task("killed_once", mark=str(tmp_path / "mark")), *squares(5)], client)
    assert found[f"killed_once {tmp_path / 'mark'}"].content == "the second time"
    assert len(lines_in(tmp_path)) == 6


def test_what_a_killed_worker_has_started_ends_with_it(tmp_path, client):
    found, _ = carried_out(tmp_path, [task("started", mark=str(tmp_path / "mark"))], client)
    (result,) = found.values()
    assert not Path(f"/proc/{result.content}").exists()


def test_a_failure_is_told_and_tried_again_by_the_next_campaign(tmp_path, client):
    tasks = [task("raised", text="no luck"), *squares(3)]
    for times in (1, 2):
        found, _ = carried_out(tmp_path, tasks, client)
        assert "ValueError: no luck" in found["raised no luck"].problem
        assert sum(not each.is_finished for each in lines_in(tmp_path)) == times
    assert len(lines_in(tmp_path)) == 5


def test_results_of_tasks_done_twice_must_agree(tmp_path, client):
    _, differing = carried_out(tmp_path, [*squares(20), task("drawn")], client, twice=1)
    assert [each.key for each in differing] == ["drawn"]
    assert len(lines_in(tmp_path)) == 21


def test_a_worker_has_records_of_its_own(tmp_path, client):
    found, _ = carried_out(tmp_path, [task("worker")], client)
    content = found["worker"].content
    assert not Path(content["state"]).is_relative_to(state_folder())
    assert Path(content["state"]) != state_folder()
    assert content["machine"] == "None"


def test_a_worker_connects_to_no_instrument(tmp_path, client):
    with socket.create_server(("127.0.0.1", 0)) as chamber:
        chamber.settimeout(0.1)
        port = chamber.getsockname()[1]
        found, _ = carried_out(tmp_path, [task("connected", folder=str(tmp_path / "bench"), port=port)], client)
        (result,) = found.values()
        assert "may use simulated ones only" in f"{result.content} {result.problem}"
        with pytest.raises(TimeoutError):
            chamber.accept()


def test_a_worker_with_another_program_is_refused_and_results_of_others_are_kept(tmp_path, client, monkeypatch):
    other = {**identity(), "scipy": "0.1"}
    monkeypatch.setattr(order, "identity", lambda: other)
    with pytest.raises(InputError, match=r"another program on a worker: .* has scipy .* instead of 0\.1"):
        carried_out(tmp_path, squares(5), client)
    monkeypatch.undo()
    carried_out(tmp_path, squares(5), client)
    assert len(lines_in(tmp_path)) == 5


def test_all_runs_of_an_archive_are_reduced_again(tmp_path, client):
    for seed in (1, 2):
        push(run_short(tmp_path / "runs", sequence="smoke", seed=seed).path, Destination(str(tmp_path / "archive")))
    campaign = Reductions(str(tmp_path / "archive"))
    found, _ = carried_out(tmp_path / "out", campaign.tasks(None), client)
    assert [each.content["changes"] for each in found.values()] == [[], []]
    (tmp_path / "archive" / "runs").rename(tmp_path / "away")
    failed, _ = carried_out(tmp_path / "again", campaign.tasks(None), client)
    assert [each.is_finished for each in failed.values()] == [False, False]


def test_other_users_cannot_connect_to_the_scheduler(client):
    import distributed

    plain = client.scheduler.address.replace("tls:", "tcp:")
    with pytest.raises(OSError, match=r"Timed out|reset"):
        distributed.Client(plain, timeout=2)
    with pytest.raises(OSError, match=r"Timed out|certificate"):
        distributed.Client(client.scheduler.address, security=distributed.Security.temporary(), timeout=2)


def nights(folder, seeds, workers=2, **options):
    """A process that rehearses nights of the smoke sequence."""
    words = ["faults", "smoke", "--bench", "simulated", "--seeds", str(seeds), "--workers", str(workers)]
    return subprocess.Popen(
        [*BENCH, *words, "--out", str(folder)], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def until_done(process, folder, count):
    """Wait until so many results are there."""
    until_s = time.monotonic() + 120
    while not (folder / "results.jsonl").exists() or len(lines_in_part(folder)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until_s
        time.sleep(0.02)


def lines_in_part(folder):
    """Whole lines of the results that are being written."""
    return (folder / "results.jsonl").read_bytes().split(b"\n")[:-1]


def compared(folder):
    """What does not depend on who did it and when."""
    return sorted((each.key, each.task, str(each.content), each.problem) for each in lines_in(folder))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Thirty nights by one worker."""
    folder = tmp_path_factory.mktemp("undisturbed")
    process = nights(folder, 30, workers=1)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert "30 nights, each ended as it should" in out
    return compared(folder)


def test_two_workers_killed_on_the_way_lose_nothing_and_double_nothing(tmp_path, undisturbed):
    process = nights(tmp_path, 30)
    for count in (4, 12):
        until_done(process, tmp_path, count)
        os.kill(workers_under(process.pid)[0], signal.SIGKILL)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert "30 nights, each ended as it should" in out
    assert compared(tmp_path) == undisturbed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL, signal.SIGTERM])
def test_a_campaign_that_is_ended_goes_on(tmp_path, undisturbed, number):
    process = nights(tmp_path, 30, start_new_session=True)
    until_done(process, tmp_path, 5)
    workers = workers_under(process.pid)
    assert len(workers) == 2
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    _, err = process.communicate(timeout=60)
    if number != signal.SIGKILL:
        assert process.returncode == 4
        assert "the same command goes on" in err
        assert "Traceback" not in err
    until_s = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < until_s, "its workers are left"
        time.sleep(0.1)
    before = lines_in_part(tmp_path)
    assert 5 <= len(before) < 30
    again = nights(tmp_path, 30)
    _, err = again.communicate(timeout=300)
    assert again.returncode == 0, err
    assert lines_in_part(tmp_path)[: len(before)] == before
    assert compared(tmp_path) == undisturbed

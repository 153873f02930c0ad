"""A worker has no rights to a bench."""

import asyncio
import pickle

import pytest

from bench.campaign import work
from bench.campaign.isolation import isolate
from bench.campaign.program import digest_of, identity
from bench.store.machine_state import VARIABLE, machine_folder
from bench.store.user_state import state_folder
from drivers.errors import CannotConnect
from drivers.transport.address import Address
from drivers.transport.wires import SIMULATED_ONLY, RealWires


@pytest.fixture
def isolated(monkeypatch, tmp_path):
    """This process as a worker."""
    for name in (SIMULATED_ONLY, VARIABLE, "XDG_STATE_HOME"):
        monkeypatch.setenv(name, "")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    isolate.cache_clear()
    yield isolate()
    isolate.cache_clear()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:502", "serial:///dev/ttyUSB0", "can:socketcan/can0"])
def test_a_worker_refuses_real_connections(isolated, address):
    async def connect():
        await RealWires().stream("chamber", Address.parse(address), asyncio.Protocol)

    async def listen():
        await RealWires().frames("counter", Address.parse(address))

    for opening in (connect, listen):
        with pytest.raises(CannotConnect, match="simulated ones only"):
            asyncio.run(opening())


def test_a_worker_keeps_its_records_to_itself(isolated):
    assert state_folder().is_relative_to(isolated)
    assert machine_folder() is None


def test_a_task_of_another_program_is_refused():
    with pytest.raises(work.OtherProgram) as refusal:
        work.do("a", "digest", "tests.support.campaign_tasks:nothing", {}, digest_of({**identity(), "sources": "0"}))
    assert pickle.loads(pickle.dumps(refusal.value)).found == identity()


def test_what_a_task_raises_is_its_problem_with_its_place(isolated):
    found = work.do("a", "digest", "tests.support.campaign_tasks:raised", {"text": "so\nit is"}, digest_of(identity()))
    assert not found.is_finished
    assert found.problem.startswith("ValueError: so it is (campaign_tasks.py:")


@pytest.mark.parametrize("does", ["tests.support.none:nothing", "tests.support.campaign_tasks:none"])
def test_a_function_that_is_not_there_is_the_problem_of_its_task(isolated, does):
    assert "none" in work.do("a", "digest", does, {}, digest_of(identity())).problem


def test_a_content_that_is_no_json_is_the_problem_of_its_task(isolated):
    assert "TypeError" in work.do("a", "digest", "pathlib:Path", {}, digest_of(identity())).problem

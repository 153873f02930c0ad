"""Jobs: one after the other in a worker process; what they find or what ended them is kept."""

import asyncio

import pytest

from bench.errors import InputError
from bench.station.jobs import WAITING_MOST, Jobs, JobState
from tests.support import worker_processes  # noqa: F401  its tracker is to be there before


def double(number):
    if number < 0:
        raise InputError("not below 0")
    return {"found": 2 * number}


def broken():
    raise RuntimeError("a bug")


@pytest.mark.lengthy
def test_a_job_is_done_and_others_go_on_after_one_that_fails():
    async def run():
        jobs = Jobs()
        async with asyncio.TaskGroup() as group:
            work = group.create_task(jobs.work())
            jobs.ask("bad", "test", "x", "anna", double, -1)
            jobs.ask("bug", "test", "x", "anna", broken)
            first = jobs.ask("good", "test", "x", "anna", double, 4)
            assert jobs.ask("good", "test", "x", "anna", double, 5) is first
            await jobs.finished()
            work.cancel()
        jobs.close()
        return [jobs.job(id_) for id_ in ("bad", "bug", "good")]

    bad, bug, good = asyncio.run(run())
    assert (bad.state, bad.problem) == (JobState.FAILED, "not below 0")
    assert bug.problem == "RuntimeError: a bug"
    assert (good.state, good.result) == (JobState.DONE, {"found": 8})


def test_too_many_jobs_are_refused():
    async def run():
        jobs = Jobs()
        for number in range(WAITING_MOST):
            jobs.ask(str(number), "test", "x", "anna", double, number)
        with pytest.raises(InputError, match="wait already"):
            jobs.ask("more", "test", "x", "anna", double, 1)
        assert jobs.find("more") is None

    asyncio.run(run())

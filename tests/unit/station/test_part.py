"""A part of a station goes on after errors of the disk, and shows the last one."""

import asyncio

import pytest

from bench.errors import StoreError
from bench.station.part import Part


class Failing(Part):
    every_s = 0.0

    def __init__(self, *errors):
        super().__init__()
        self.errors, self.seen, self.enough = list(errors), [], asyncio.Event()

    async def look(self):
        self.seen.append(self.problem)
        if len(self.seen) > len(self.errors) + 1:
            self.enough.set()
        if len(self.seen) <= len(self.errors):
            raise self.errors[len(self.seen) - 1]


def worked(part):
    async def main():
        working = asyncio.create_task(part.work())
        await asyncio.wait([working, enough := asyncio.create_task(part.enough.wait())], return_when="FIRST_COMPLETED")
        for task in (working, enough):
            task.cancel()
        await asyncio.gather(working, enough, return_exceptions=True)
        return None if working.cancelled() else working.exception()

    return asyncio.run(main())


def test_an_error_of_the_disk_is_shown_until_the_work_succeeds():
    part = Failing(StoreError("the disk is full"), OSError(28, "No space left on device"))
    assert worked(part) is None
    assert part.seen[:4] == ["", "the disk is full", "[Errno 28] No space left on device", ""]


@pytest.mark.leaves("the task that failed, as it must")
def test_an_error_of_the_program_ends_the_part():
    assert isinstance(worked(Failing(KeyError("seq"))), KeyError)

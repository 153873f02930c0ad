"""A part of a station goes on after errors of the disk, and shows the last one."""

import asyncio

import pytest

from bench.errors import StoreError
from bench.station.part import Part


class Failing(Part):
    every_s = 0.0

    def __init__(self, *errors):
        super().__init__()
        self.errors, self.seen = list(errors), []

    async def look(self):
        self.seen.append(self.problem)
        if len(self.seen) > len(self.errors):
            return
        raise self.errors[len(self.seen) - 1]


def worked(part, turns):
    async def main():
        working = asyncio.create_task(part.work())
        while len(part.seen) < turns and not working.done():
            await asyncio.sleep(0)
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)
        return None if working.cancelled() else working.exception()

    return asyncio.run(main())


def test_an_error_of_the_disk_is_shown_until_the_work_succeeds():
    part = Failing(StoreError("the disk is full"), OSError(28, "No space left on device"))
    assert worked(part, 5) is None
    assert part.seen[:4] == ["", "the disk is full", "[Errno 28] No space left on device", ""]


@pytest.mark.leaves("the task that failed, as it must")
def test_an_error_of_the_program_ends_the_part():
    assert isinstance(worked(Failing(KeyError("seq")), 5), KeyError)

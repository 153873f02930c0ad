"""Worker processes: what waits for one that is ended is told so, and is not taken for a request that has gone."""

import asyncio
import time

import pytest

from bench.errors import InputError
from bench.station.worker import Workers
from tests.support import worker_processes  # noqa: F401  its tracker is to be there before


@pytest.mark.lengthy
def test_work_that_waits_behind_work_without_end_is_refused_and_the_next_is_done():
    async def main():
        workers = Workers(limit_s=60.0)
        try:
            assert await workers.call(abs, -1) == 1
            workers._limit_s = 0.5
            endless = asyncio.create_task(workers.call(time.sleep, 60.0))
            await asyncio.sleep(0.1)
            workers._limit_s = 60.0
            waiting = [asyncio.create_task(workers.call(abs, -n)) for n in range(5)]
            found = await asyncio.gather(endless, *waiting, return_exceptions=True)
            return found, await workers.call(abs, -2)
        finally:
            workers.close()

    (endless, *waiting), after = asyncio.run(main())
    assert "has not ended within" in str(endless)
    assert all(isinstance(each, InputError) for each in waiting), waiting
    assert after == 2

"""Worker processes: what waits for one that is ended is told so, and is not taken for a request that has gone."""

import asyncio
import os
import time
from multiprocessing.connection import Connection

import pytest

from bench.errors import InputError
from bench.station.worker import Workers
from tests.support import worker_processes  # noqa: F401  its tracker is to be there before


def half_of_a_result():
    """Return a result of which only the first 5 bytes are sent."""

    def send(connection: Connection, message: bytes) -> None:
        os.write(connection.fileno(), bytes(message)[:5])
        time.sleep(60.0)

    Connection._send = send
    return "result"


@pytest.mark.lengthy
@pytest.mark.timeout(60)
def test_a_process_that_is_ended_while_it_sends_its_result_holds_nothing_up():
    async def main():
        workers = Workers(limit_s=60.0)
        try:
            assert await workers.call(abs, -1) == 1  # its process has begun
            workers._limit_s = 0.5
            with pytest.raises(InputError, match="half of a result has not ended within"):
                await workers.call(half_of_a_result)
            workers._limit_s = 60.0
            return await workers.call(abs, -2)
        finally:
            workers.close()

    assert asyncio.run(main()) == 2


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

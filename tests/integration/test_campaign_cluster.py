"""A campaign at a scheduler of its own, with the certificates and commands of the how-to page."""

import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time

import pytest

from tests.support.campaign_tasks import lines_in
from tests.support.how_to import FOLDER
from tests.support.runs import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.slow, pytest.mark.timeout(400)]
BLOCKS = re.findall(r"^```bash\n(.*?)^```$", (FOLDER / "campaigns.md").read_text("utf-8"), re.DOTALL | re.MULTILINE)
CERTIFICATES, SCHEDULER, WORKERS, CAMPAIGN = BLOCKS
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2"}


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """A folder with the files of the page."""
    folder = tmp_path_factory.mktemp("certificates")
    subprocess.run(["bash", "-euc", CERTIFICATES], cwd=folder, check=True, capture_output=True)
    return folder


@pytest.fixture
def port():
    """A free port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@pytest.fixture
def started(certificates):
    """Starts programs, which are ended after the test."""
    running = []

    def start(text, port, **changed):
        words = shlex.split(text.replace("\\\n", " ").replace("SCHEDULER:8786", f"127.0.0.1:{port}"))
        words = [changed.get(word, word).replace("8786", str(port)) for word in words]
        commands = {"dask": ["-m", "dask"], "bench": ["-m", "bench"]}
        process = subprocess.Popen(
            [sys.executable, *commands[words[0]], *words[1:]], cwd=certificates, env=ENVIRONMENT, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        running.append(process)
        return process

    yield start
    for process in running:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def until_open(port):
    until_s = time.monotonic() + 60
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return
        except OSError:
            assert time.monotonic() < until_s
            time.sleep(0.2)


def ended(process, code):
    out, err = process.communicate(timeout=300)
    assert process.returncode == code, (out, err)
    return out, err


def test_a_cluster_by_the_page_and_a_scheduler_that_is_killed(certificates, port, started, tmp_path):
    few = {"1000": "60", "8": "2"}
    scheduler = started(SCHEDULER, port)
    until_open(port)
    started(WORKERS, port, **few)
    campaign = started(f"{CAMPAIGN.rstrip()} --out {tmp_path}", port, **few)
    while not (tmp_path / "results.jsonl").exists():
        assert campaign.poll() is None, campaign.communicate()
        time.sleep(0.1)
    os.killpg(scheduler.pid, signal.SIGKILL)
    _, err = ended(campaign, 3)
    assert "the connection to the scheduler is lost" in err
    assert "Traceback" not in err, err
    done = len(lines_in(tmp_path))
    assert 1 <= done < 60
    started(SCHEDULER, port)
    until_open(port)
    started(WORKERS, port, **few)
    out, _ = ended(started(f"{CAMPAIGN.rstrip()} --out {tmp_path}", port, **few), 0)
    assert "60 nights, each ended as it should" in out
    found = lines_in(tmp_path)
    assert len(found) == len({each.task for each in found}) == 60


def test_a_client_of_another_authority_is_refused(certificates, port, started, tmp_path_factory, tmp_path):
    others = tmp_path_factory.mktemp("others")
    subprocess.run(["bash", "-euc", CERTIFICATES], cwd=others, check=True, capture_output=True)
    started(SCHEDULER, port)
    until_open(port)
    changed = {name: str(others / name) for name in ("ca.pem", "client.pem", "client-key.pem")}
    _, err = ended(started(f"{CAMPAIGN.rstrip()} --out {tmp_path}", port, **changed), 3)
    assert "no connection to the scheduler" in err
    assert "of the same authority" in err

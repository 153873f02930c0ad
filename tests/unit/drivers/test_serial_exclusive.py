"""A serial port that this program has open is closed to the programs of other users."""

import os
import subprocess

import pytest

from drivers.transport.address import Address
from drivers.transport.serial import _keep_others_out

NOBODY = 65534


def opened_by_another_user(path):
    """What the shell of another user says when it opens a device; empty where it can."""
    command = ["/bin/sh", "-c", 'exec 3<>"$0"', path]
    return subprocess.run(
        command, user=NOBODY, group=NOBODY, extra_groups=[], capture_output=True, text=True, env={"LC_ALL": "C"},
        cwd="/", check=False,
    ).stderr  # fmt: skip


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user, whom the kernel keeps out")
def test_no_other_user_can_open_a_port_that_is_in_use():
    other_end, line = os.openpty()
    path = os.ttyname(line)
    os.chmod(path, 0o666)
    with os.fdopen(other_end, "rb", buffering=0), os.fdopen(line, "r+b", buffering=0) as port:
        if message := opened_by_another_user(path):
            pytest.skip(f"another user cannot open pseudo-terminals here: {message}")
        _keep_others_out(port, Address.parse("serial:///dev/ttyS0"))
        assert "busy" in opened_by_another_user(path)

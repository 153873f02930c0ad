"""What a server refuses to start with."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.errors import InputError
from bench.web.listening import Listening, address_for_others, banner_of, expect_safe, expect_secret
from tests.support.web import with_station

FILE = Path("certificate.pem")


def test_a_network_is_served_with_users_and_tls_or_with_a_banner(tmp_path):
    async def act(here):
        for users in (False, True):
            if users:
                here.add_users()
            for host in ("0.0.0.0", "::", "192.168.1.5", "127.0.0.2", "bench.lab"):
                for file in (None, FILE):
                    listening = Listening(host, certificate=file, key=file)
                    if users and file:
                        expect_safe(listening, here.identity)
                        assert banner_of(listening, here.identity) == ""
                        continue
                    with pytest.raises(InputError, match="needs "):
                        expect_safe(listening, here.identity)
                    insecure = listening._replace(insecure=True)
                    expect_safe(insecure, here.identity)
                    assert banner_of(insecure, here.identity)
            for host in ("127.0.0.1", "::1", "localhost"):
                expect_safe(Listening(host), here.identity)
                assert banner_of(Listening(host), here.identity) == ""

    with_station(tmp_path, act)


@pytest.mark.parametrize(
    ("mode", "for_token", "for_key"),
    [(0o600, True, True), (0o640, False, True), (0o604, False, False), (0o620, False, False)],
)
def test_files_with_secrets_are_for_their_owner(tmp_path, mode, for_token, for_key):
    file = tmp_path / "secret"
    file.touch()
    file.chmod(mode)
    for token, key, fine in ((file, None, for_token), (tmp_path / "none", file, for_key)):
        if fine:
            expect_secret(token, key)
        else:
            with pytest.raises(InputError, match="chmod 600"):
                expect_secret(token, key)


def test_the_address_for_others_is_the_first_name_else_that_of_the_server():
    url = "https://0.0.0.0:8421/"
    assert address_for_others(Listening("0.0.0.0"), url) == ""
    assert address_for_others(Listening("0.0.0.0", hosts=("bench.lab", "other")), url) == "https://bench.lab:8421/"
    assert address_for_others(Listening("192.168.1.5"), "http://192.168.1.5:8421/") == "http://192.168.1.5:8421/"
    assert address_for_others(Listening(hosts=("bench.lab",)), "http://127.0.0.1:8421/") == "http://127.0.0.1:8421/"

"""Attempts at a run: whatever dies, when, an attempt is made once or not at all, and its state is known."""

import subprocess
import sys
import threading

import pytest

from bench.errors import InputError
from bench.station.queue import attempts
from bench.station.queue.attempts import claim, look, make, prepare, withdraw

_pause = threading.Event().wait


def prepared(tmp_path, *words):
    folder = tmp_path / "1"
    prepare(folder, words or ("run", "smoke"), tmp_path)
    return folder


def making(folder):
    return subprocess.Popen([sys.executable, "-m", "bench", "attempt", str(folder)], stderr=subprocess.PIPE, text=True)


def test_an_attempt_that_nobody_makes_has_not_begun_and_can_be_withdrawn(tmp_path):
    folder = prepared(tmp_path)
    assert look(folder) == (False, False, "")
    assert withdraw(folder)
    assert not look(folder).has_begun
    with pytest.raises(InputError, match="made or withdrawn before"):
        make(folder)


def test_an_attempt_that_was_claimed_cannot_be_withdrawn(tmp_path):
    folder = prepared(tmp_path)
    assert claim(folder)
    assert not withdraw(folder)
    assert not claim(folder)


@pytest.mark.lengthy
def test_an_attempt_is_the_process_of_its_command_and_its_output_is_kept(tmp_path):
    folder = prepared(tmp_path, "check", "smok")
    with making(folder) as process:
        assert process.communicate() == (None, "")
    assert process.returncode == 2
    lives, has_begun, messages = look(folder)
    assert (lives, has_begun) == (False, True)
    assert "did you mean 'smoke'" in messages
    with making(folder) as again:
        assert "made or withdrawn before" in again.communicate()[1]


@pytest.mark.lengthy
def test_an_attempt_lives_until_its_process_is_killed(tmp_path):
    folder = prepared(tmp_path, "run", "smoke", "--speed", "1", "--runs", str(tmp_path / "runs"))
    with making(folder) as process:
        while not (folder / attempts.MESSAGES).exists() or not (folder / attempts.MESSAGES).read_text():
            assert process.poll() is None
            _pause(0.02)
        assert look(folder).lives
        process.kill()
        process.wait()
        found = look(folder)
    assert (found.lives, found.has_begun) == (False, True)


def test_what_a_process_has_printed_is_shown_without_control_characters(tmp_path):
    folder = prepared(tmp_path)
    (folder / attempts.MESSAGES).write_bytes(b"\x1b[31mred\x07 " + b"x" * 5000 + b"\xff\nend\n")
    found = look(folder).messages
    assert found.endswith("\ufffd\nend")
    assert all(letter.isprintable() or letter == "\n" for letter in found)
    assert len(found) <= attempts.SHOWN_BYTES


def test_a_folder_without_an_attempt_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no attempt"):
        make(tmp_path)

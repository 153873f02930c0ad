"""Texts of sequences and their versions in a git folder: nothing is lost, nothing outside the folder is touched."""

from __future__ import annotations

import os
import subprocess
from concurrent.futures import ThreadPoolExecutor

import pytest

from bench.config.document import SIZE_LIMIT_BYTES
from bench.errors import InputError, StoreError
from bench.station.prepare.differences import difference
from bench.station.prepare.texts import FOUND, ChangedError, Texts
from bench.station.settings import read_station

FIRST, SECOND = "title: first\n", "title: second\n"


def git(folder, *words):
    env = {**os.environ, "GIT_CONFIG_GLOBAL": os.devnull, "HOME": str(folder)}
    who = ("-c", "user.name=Eve", "-c", "user.email=eve@lab")
    return subprocess.run(
        ["git", "-C", folder, *who, *words], check=True, capture_output=True, text=True, env=env
    ).stdout


def texts_of(tmp_path, sequences=None):
    settings = read_station(None, tmp_path / "station", runs=tmp_path / "runs")
    return Texts(settings._replace(sequences=sequences))


@pytest.fixture
def texts(tmp_path):
    return texts_of(tmp_path)


def digest(texts, name):
    return texts.text(name).digest


def test_saved_texts_are_versions_with_author_message_and_difference(texts):
    assert texts.versions("mine") == []
    first = texts.save("mine", FIRST, "", "Åsa <x> O'Hara", "# begun; $(touch x)")
    assert (first.own, first.text, first.file) == (True, FIRST, str(texts.folder / "mine.yaml"))
    texts.save("mine", "title: second\r\n\r\n", first.digest, "bob", "CRLF of a form")
    texts.save("other", FIRST, "", "bob", "another file")
    new, old = texts.versions("mine")
    assert (new.by, new.message, old.message) == ("bob", "CRLF of a form", "# begun; $(touch x)")
    assert old.by == "Åsa x O'Hara"
    assert (texts.version("mine", old.id), texts.version("mine", new.id)) == (FIRST, SECOND)
    assert difference(FIRST, SECOND, "old", "new")[-2:] == ["-title: first", "+title: second"]
    assert not (texts.folder / "x").exists()
    assert git(texts.folder, "status", "--porcelain") == ""


def test_of_two_who_edit_the_second_is_refused_and_the_file_is_that_of_the_first(texts):
    base = texts.save("mine", FIRST, "", "ann", "begun").digest
    texts.save("mine", SECOND, base, "ann", "mine")
    with pytest.raises(ChangedError, match="nothing was saved") as refused:
        texts.save("mine", "title: third\n", base, "bob", "mine too")
    assert refused.value.now.text == SECOND
    assert texts.text("mine").text == SECOND
    with pytest.raises(ChangedError):
        texts.save("gone", FIRST, base, "bob", "of a sequence that is gone")
    assert texts.save("mine", "title: third\n", refused.value.now.digest, "bob", "over it").text == "title: third\n"


def test_of_many_at_once_one_is_saved(texts):
    base = texts.save("mine", FIRST, "", "ann", "begun").digest

    def save(number):
        try:
            return texts.save("mine", f"title: of {number}\n", base, f"n{number}", "at once").text
        except ChangedError:
            return None

    with ThreadPoolExecutor(6) as pool:
        (saved,) = filter(None, pool.map(save, range(6)))
    assert texts.text("mine").text == saved
    assert len(texts.versions("mine")) == 2


def test_a_change_without_the_station_is_a_version_before_the_next_one(texts):
    base = texts.save("mine", FIRST, "", "ann", "begun").digest
    (texts.folder / "mine.yaml").write_text("title: by hand\n")
    with pytest.raises(ChangedError):
        texts.save("mine", SECOND, base, "ann", "mine")
    texts.save("mine", SECOND, digest(texts, "mine"), "ann", "mine")
    assert [(each.by, each.message) for each in texts.versions("mine")] == [
        ("ann", "mine"), ("station", FOUND), ("ann", "begun"),
    ]  # fmt: skip


def test_a_folder_of_the_laboratory_in_a_work_tree_keeps_its_index_and_runs_no_hook(tmp_path):
    lab = tmp_path / "lab"
    (lab / "sequences").mkdir(parents=True)
    git(lab, "init")
    ran = lab / "ran"
    for hook in ("pre-commit", "post-commit", "commit-msg"):
        path = lab / ".git/hooks" / hook
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"#!/bin/sh\ntouch {ran}\nexit 1\n")
        path.chmod(0o755)
    git(lab, "config", "core.fsmonitor", f"touch {ran}; false")
    (lab / "sequences/mine.yaml").write_text(FIRST)
    (lab / "staged.txt").write_text("of somebody")
    git(lab, "-c", "core.fsmonitor=false", "add", "staged.txt")
    texts = texts_of(tmp_path, lab / "sequences")
    texts.save("mine", SECOND, digest(texts, "mine"), "ann", "mine")
    assert [each.by for each in texts.versions("mine")] == ["ann", "station"]
    assert not ran.exists()
    assert not (lab / "sequences/.git").exists()
    assert git(lab, "-c", "core.fsmonitor=false", "status", "--porcelain") == "A  staged.txt\n"


def test_the_folder_of_the_station_belongs_to_no_work_tree_around_it(tmp_path):
    git(tmp_path, "init")
    texts = texts_of(tmp_path)
    texts.save("mine", FIRST, "", "ann", "begun")
    assert (texts.folder / ".git").is_dir()
    with pytest.raises(subprocess.CalledProcessError):
        git(tmp_path, "rev-parse", "HEAD")


def test_if_git_fails_the_file_is_as_it_was(texts):
    base = texts.save("mine", FIRST, "", "ann", "begun").digest
    (texts.folder / ".git/index.lock").touch()
    with pytest.raises(StoreError, match=r"git add has failed .*index\.lock"):
        texts.save("mine", SECOND, base, "ann", "mine")
    with pytest.raises(StoreError):
        texts.save("new", SECOND, "", "ann", "mine")
    assert texts.text("mine").text == FIRST
    assert not (texts.folder / "new.yaml").exists()
    (texts.folder / ".git/index.lock").unlink()
    texts.save("mine", SECOND, base, "ann", "mine")


def test_without_git_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(StoreError, match="apt install git"):
        texts_of(tmp_path).save("mine", FIRST, "", "ann", "begun")


@pytest.mark.parametrize(
    "name",
    ["", "../mine", "/etc/passwd", "a/b", ".git", "..", "--output=x", "-m", "a\0b", "a\nb", "x" * 65, "a b", "ä"],
)
def test_a_name_outside_the_folder_is_refused(texts, name):
    for act in (
        lambda: texts.save(name, FIRST, "", "ann", "begun"), lambda: texts.versions(name),
        lambda: texts.version(name, "a" * 40), lambda: texts.text(name),
    ):  # fmt: skip
        with pytest.raises(InputError, match="no name of a sequence"):
            act()
    assert not texts.folder.exists()


def test_a_link_out_of_the_folder_is_not_written_through(tmp_path, texts):
    texts.save("mine", FIRST, "", "ann", "begun")
    outside = tmp_path / "outside.yaml"
    outside.write_text(FIRST)
    (texts.folder / "link.yaml").symlink_to(outside)
    (texts.folder / "folder.yaml").mkdir()
    for name in ("link", "folder"):
        for base in ("", digest(texts, "mine")):
            with pytest.raises(InputError, match="not a file of this folder"):
                texts.save(name, SECOND, base, "ann", "out")
    assert outside.read_text() == FIRST


@pytest.mark.parametrize("version", ["HEAD", "--help", "a" * 39, "0" * 40, "HEAD:../../x", "b" * 64])
def test_only_versions_of_the_file_are_shown(texts, version):
    texts.save("mine", FIRST, "", "ann", "begun")
    with pytest.raises(InputError, match="there is no version"):
        texts.version("mine", version)


def test_what_is_no_change_or_no_text_is_refused(texts):
    base = texts.save("mine", FIRST, "", "ann", "begun").digest
    for text, message, why in (
        (FIRST, "again", "nothing has changed"), (SECOND, "  ", "what has changed, and why"),
        ("x" * SIZE_LIMIT_BYTES, "long", "at most 32 KiB"), ("\ud800", "half", "half a character"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=why):
            texts.save("mine", text, base, "ann", message)
    with pytest.raises(InputError, match="already; choose another name"):
        texts.save("mine", SECOND, "", "ann", "as new")
    assert len(texts.versions("mine")) == 1

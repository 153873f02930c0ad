"""Files and folders that are whole or not there, whatever stops the writing."""

import os
from pathlib import Path

import pytest

from bench.errors import InputError, StoreError
from bench.files import atomic_file, atomic_folder, make_folder, write_atomically, written_new


@pytest.fixture
def synced(monkeypatch):
    """Inodes that were synchronised, each with the names that a folder had then."""
    found: dict[int, list[str]] = {}
    really = os.fsync

    def fsync(handle: int) -> None:
        folder = Path(os.readlink(f"/proc/self/fd/{handle}"))
        found[os.fstat(handle).st_ino] = os.listdir(folder) if folder.is_dir() else []
        really(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    return found


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    target = tmp_path / "results.json"
    write_atomically(target, b"old")

    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(StoreError, match="Input/output error"):
        write_atomically(target, b"new")
    with pytest.raises(InputError, match="cannot be written"), atomic_file(target) as draft:
        draft.write_bytes(b"new")
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def _write_and_fail(path):
    path.write_bytes(b"a part")
    1 / 0  # noqa: B018


def test_what_fails_while_it_writes_leaves_what_was_there(tmp_path):
    target = tmp_path / "readings.csv"
    write_atomically(target, b"old")
    with pytest.raises(ZeroDivisionError), atomic_file(target) as draft:
        _write_and_fail(draft)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_file_and_name_and_new_folders_are_durable(tmp_path, synced):
    target = tmp_path / "a" / "b" / "c.txt"
    with atomic_file(target) as draft:
        draft.write_text("x")
    assert target.stat().st_ino in synced
    assert "c.txt" in synced[target.parent.stat().st_ino]
    assert "b" in synced[(tmp_path / "a").stat().st_ino]
    assert "a" in synced[tmp_path.stat().st_ino]


def test_a_file_is_replaced_with_its_mode_and_through_a_link(tmp_path):
    path, link = tmp_path / "a.yaml", tmp_path / "link.yaml"
    path.write_text("a:    1\n")
    path.chmod(0o640)
    link.symlink_to(path)
    write_atomically(link, b"a: 1\n")
    assert link.is_symlink()
    assert path.read_text() == "a: 1\n"
    assert path.stat().st_mode & 0o777 == 0o640
    assert sorted(tmp_path.iterdir()) == [path, link]


def test_a_folder_or_a_device_is_not_replaced(tmp_path):
    (tmp_path / "a.yaml").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "a.yaml", tmp_path / "pipe", Path("/dev/null")):
        with pytest.raises(InputError, match=r"cannot be written .*not a regular file"), atomic_file(path) as draft:
            draft.write_text("x")
    assert len(list(tmp_path.iterdir())) == 2
    assert Path("/dev/null").is_char_device()


def test_a_new_file_never_takes_the_place_of_another(tmp_path, synced):
    target = tmp_path / "new.yaml"
    with written_new(target) as draft:
        draft.write_text("first")
    assert "new.yaml" in synced[tmp_path.stat().st_ino]
    with pytest.raises(FileExistsError), written_new(target) as draft:
        draft.write_text("second")
    assert target.read_text() == "first"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_is_filled_before_it_has_its_name(tmp_path, synced):
    target = tmp_path / "driver"
    with pytest.raises(ZeroDivisionError), atomic_folder(target) as draft:
        _write_and_fail(draft / "one.py")
    assert list(tmp_path.iterdir()) == []
    with atomic_folder(target) as draft:
        (draft / "below").mkdir()
        (draft / "below" / "one.py").write_text("1")
        assert not target.exists()
    assert (target / "below" / "one.py").stat().st_ino in synced
    assert "driver" in synced[tmp_path.stat().st_ino]
    with pytest.raises(FileExistsError), atomic_folder(target):
        pass


def test_making_a_folder_that_is_there_does_nothing(tmp_path, synced):
    make_folder(tmp_path)
    assert synced == {}

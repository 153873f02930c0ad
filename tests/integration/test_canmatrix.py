"""canmatrix, which other people wrote, reads the shipped DBC files as cantools does, which our drivers use."""

from pathlib import Path

import cantools
import pytest
from cantools.database.can import Database

from tests.support.runs import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.peer("canmatrix")]

FILES = sorted((ROOT / "config").rglob("*.dbc"))


@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
def test_another_reader_finds_the_same_frames_and_signals(path: Path) -> None:
    import canmatrix.formats

    database = cantools.database.load_file(path)
    assert isinstance(database, Database)
    ours = {
        (message.frame_id, message.name, message.length): {
            (
                signal.name, signal.start, signal.length, signal.is_signed, signal.byte_order == "little_endian",
                float(signal.scale), float(signal.offset), signal.unit or "",
            )
            for signal in message.signals
        }
        for message in database.messages
    }  # fmt: skip
    (matrix,) = canmatrix.formats.loadp(str(path)).values()
    theirs = {
        (frame.arbitration_id.id, frame.name, frame.size): {
            (
                signal.name, signal.get_startbit(bit_numbering=1), signal.size, signal.is_signed,
                signal.is_little_endian, float(signal.factor), float(signal.offset), signal.unit,
            )
            for signal in frame.signals
        }
        for frame in matrix.frames
    }  # fmt: skip
    assert matrix.load_errors == []
    assert theirs == ours

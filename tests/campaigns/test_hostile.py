"""A sample of `make hostile`, without plans of very many steps and a look at the time; and a file far too large."""

from __future__ import annotations

import pytest

from campaigns.hostile.documents import KINDS, Hostile, hostile
from campaigns.hostile.trial import LONG_PLANS, REFUSED, Readers

SEED = 7
COUNT = 300


@pytest.fixture(scope="module")
def readers(tmp_path_factory):
    return Readers(tmp_path_factory.mktemp("hostile"))


def test_documents_are_read_or_refused_in_our_own_words(readers):
    documents = [hostile(SEED, index) for index in range(COUNT)]
    quick = [document for document in documents if document.kind not in LONG_PLANS]
    assert len({document.kind for document in quick}) == len(KINDS) - len(LONG_PLANS)
    readings = [reading for document in quick for reading in readers.read(document)]
    assert [reading for reading in readings if reading.is_offence] == []
    assert {reading.outcome for reading in readings} == {"accepted", "refused"}


def test_a_document_is_the_same_whenever_it_is_made():
    assert [hostile(SEED, index) for index in range(50)] == [hostile(SEED, index) for index in range(50)]
    assert hostile(SEED, 0) != hostile(SEED + 1, 0)


def test_a_file_of_50_mb_is_refused_by_its_size_alone(readers):
    for reading in readers.read(Hostile(0, "large", bytes(50_000_000))):  # which would be refused for its bytes, too
        assert reading.outcome == REFUSED
        assert "has 50000000 bytes, at most 32768 are read" in reading.detail

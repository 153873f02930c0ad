"""When garbage is collected."""

import gc

import pytest

from bench.cli.collection import uncollected


def test_garbage_is_not_collected_while_a_command_loads_and_is_again_after_an_error():
    try:
        with pytest.raises(ValueError, match="planted"), uncollected():
            assert not gc.isenabled()
            raise ValueError("planted")
        assert gc.isenabled()
    finally:
        gc.unfreeze()

"""When garbage is collected."""

import gc

import pytest

from bench.cli.collection import uncollected


@uncollected()
def broken():
    assert not gc.isenabled()
    raise ValueError("planted")


def test_garbage_is_not_collected_while_a_command_loads_and_is_again_after_an_error():
    with pytest.raises(ValueError, match="planted"):
        broken()
    is_collected = gc.isenabled()
    gc.unfreeze()
    assert is_collected

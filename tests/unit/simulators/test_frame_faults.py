"""Faults of a bus act on frames, however their block is given."""

import numpy as np
import pytest

from simulators.faults.frame_faults import FrameFault, apply_fault
from tests.support.frames import in_order_of_messages
from tests.unit.drivers.test_sorted_block import check_alike, drawn


@pytest.mark.parametrize("fault", FrameFault)
def test_a_fault_of_a_sorted_block_is_that_of_its_frames(fault: FrameFault) -> None:
    block = drawn(300, 7)
    swapped = np.unique(block.ids).tolist()
    plain, by_message = (
        apply_fault(fault, each, np.random.default_rng(8), 0.3, swapped)
        for each in (block, in_order_of_messages(block))
    )
    check_alike(by_message.block, plain.block)
    assert np.array_equal(by_message.rows, plain.rows)
    assert np.array_equal(by_message.altered, plain.altered)
    assert len(plain.block) != len(block) or (plain.rows != np.arange(len(block))).any() or plain.altered.any()

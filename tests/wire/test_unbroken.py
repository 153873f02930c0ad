"""Frames that go on from block to block, and some that do not, typed as in `test_can_counter`."""

from collections.abc import Callable

import pytest

from drivers.can.frame_block import FrameBlock
from drivers.dialects.can_counter.wire import unbroken
from tests.support.frames import frames, in_order_of_messages
from tests.support.laboratory import counter_form

Lines = tuple[str, ...]
Form = Callable[[FrameBlock], FrameBlock]
EITHER_FORM = pytest.mark.parametrize("form", [lambda block: block, in_order_of_messages], ids=["plain", "sorted"])
FORM = counter_form()


def sent(number: int, tick: int | None = None, axes: str = "123") -> Lines:
    """A latch with its three axes, as they are sent: one every 100,000 ticks of 1 µs."""
    ticks = (100_000 * number if tick is None else tick) % (1 << 32)
    latch = f"100 8 {ticks.to_bytes(4, 'little').hex()} {(number % 65536).to_bytes(2, 'little').hex()} 00 03"
    numbered = (number % 65536).to_bytes(2, "little").hex()
    return latch, *(f"10{axis} 8 000000 000000 {numbered}" for axis in axes)


def run(first: int, last: int) -> Lines:
    return tuple(line for number in range(first, last + 1) for line in sent(number))


@EITHER_FORM
@pytest.mark.parametrize(
    "blocks",
    [
        (run(1, 4),),
        (run(1, 2), (), run(3, 4)),
        (run(65534, 65537), run(65538, 65540)),  # the number goes round
        (run(1, 2), sent(3)[:2], (*sent(3)[2:], *run(4, 5))),  # a block ends within a latch
        ((*sent(9)[2:], *run(10, 12)),),  # the first one does not begin with a latch
        (sent(9)[3:], run(10, 12)),
        (run(10, 12), sent(13)[:2]),  # the last one is cut
        (("110 6 54 F0 C4 09 2A 00", *run(1, 2), "7FF 1 00", *run(3, 4)),),  # other frames between them
        ((),),
    ],
)
def test_frames_that_go_on(blocks: tuple[Lines, ...], form: Form) -> None:
    look = unbroken(FORM)
    for lines in blocks:
        look.take(form(frames(*lines)))
    assert look.is_whole


@EITHER_FORM
@pytest.mark.parametrize(
    "blocks",
    [
        (run(1, 2) + run(4, 5),),  # a latch with all its frames
        (run(1, 2), run(4, 5)),  # between two blocks
        ((*run(1, 2), *sent(3)[1:], *run(4, 5)),),  # only the latch
        ((*run(1, 2), *sent(3, axes="12"), *run(4, 5)),),  # only an axis
        (run(1, 2), (*sent(3, axes="12"), *sent(4, axes="12")), sent(5, axes="12")),  # an axis has ended
        ((*sent(1, axes="23"), *run(2, 4)),),  # an axis of the first latch
        ((*run(1, 3), *sent(3)[3:], *sent(4, axes="12"), *run(5, 6)),),  # one twice, and the next one not
        (run(1, 3), run(65536 + 4, 65536 + 6)),  # as many as make the number go round
        ((*run(1, 2), *sent(0, tick=5), *run(1, 2)),),  # it began anew
        (sent(1, axes="12"), sent(2, axes="12")),  # an axis that never came
        ((*sent(1)[1:], *sent(2)[1:]),),  # no latch at all
    ],
)
def test_frames_that_may_lack_some(blocks: tuple[Lines, ...], form: Form) -> None:
    look = unbroken(FORM)
    for lines in blocks:
        look.take(form(frames(*lines)))
    assert not look.is_whole
    look.take(form(frames(*run(9, 10))))
    assert not look.is_whole, "it is so for the rest of the acquisition"

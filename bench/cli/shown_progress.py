"""Progress of a campaign on standard error."""

from __future__ import annotations

import sys

from bench.campaign.progress import Progress
from bench.cli.streams import remark
from bench.clock import Stopwatch

LINE_EVERY_S = 30.0


class Shown:
    """Writes the progress: on a terminal over the line before, otherwise a line every half minute and at the end."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._last: Stopwatch | None = None
        self._has_ended = False

    def __call__(self, progress: Progress) -> None:
        """Write a progress if it is time."""
        is_end = progress.finished + progress.failed == progress.tasks
        if is_end and self._has_ended:
            return
        self._has_ended = is_end
        if self._is_terminal:
            sys.stderr.write(f"\r\x1b[K{progress.in_words()}" + "\n" * is_end)
            sys.stderr.flush()
        elif is_end or self._last is None or self._last.elapsed_s() >= LINE_EVERY_S:
            self._last = Stopwatch()
            remark(progress.in_words())

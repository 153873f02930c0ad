"""Line on a terminal with a bar, drawn again and again by a thread; texts scroll past above it."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn
from rich.table import Column
from rich.text import Text

BAR_CELLS = 16
MARGIN_CELLS = BAR_CELLS + 8  # bar, percentage and gaps between the columns


class Bar:
    """Bar on standard error; `line` returns the text beside it, in at most the given number of cells."""

    def __init__(self, line: Callable[[int], str]) -> None:
        self._console = Console(stderr=True)
        columns: tuple[ProgressColumn, ...] = (
            BarColumn(bar_width=BAR_CELLS),
            TaskProgressColumn(),
            _Line(lambda: line(self._console.width - MARGIN_CELLS)),
        )
        self._progress = Progress(*columns, console=self._console, transient=True, refresh_per_second=5)
        self._task = self._progress.add_task("", total=1.0)

    def start(self) -> None:
        """Start drawing."""
        self._progress.start()

    def stop(self) -> None:
        """Clear the line."""
        self._progress.stop()

    def show(self, share: float) -> None:
        """Set the part that is done."""
        self._progress.update(self._task, completed=share)

    def print(self, text: str) -> None:
        """Write a text above the line."""
        self._console.print(Text(text))


class _Line(ProgressColumn):
    """Column that reads its text each time it is drawn, and is never wrapped."""

    def __init__(self, text: Callable[[], str]) -> None:
        super().__init__(table_column=Column(no_wrap=True, overflow="ellipsis"))
        self._text = text

    def render(self, task: Task) -> Text:
        return Text(self._text(), no_wrap=True, overflow="ellipsis")

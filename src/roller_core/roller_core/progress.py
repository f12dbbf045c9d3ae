"""Progress bars and status lines that keep out of pipes.

rich draws them; it takes a tenth of a second to load, so only where there is a terminal.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Takes what is being done and the share done, 0–1.
OnProgress = Callable[[str, float], None]

#: How often a status is printed where there is no terminal, s.
_PRINT_EVERY_S = 10.0


def no_progress(_text: str, _share: float) -> None:
    """Show no progress."""


def part_of(on_progress: OnProgress, first: float, last: float) -> OnProgress:
    """What takes the progress of a part of the work, from one share of the whole to another."""
    return lambda text, share: on_progress(text, first + (last - first) * share)


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[float], None]]:
    """Show a bar on standard error; the callable takes the share done, 0–1."""
    if not sys.stderr.isatty():
        yield lambda share: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)
        bar.update(task, completed=1.0)


@contextmanager
def status_line() -> Iterator[tuple[Callable[[str], None], Callable[[str], None]]]:
    """Show a line on standard error that is written over and over.

    Yields
    ------
    show : callable
        Takes the new line. Where there is no terminal, one is printed now and then.
    report : callable
        Prints a line that stays.
    """
    if not sys.stderr.isatty():
        last = time.monotonic()

        def report(line: str) -> None:
            print(line, file=sys.stderr, flush=True)

        def now_and_then(line: str) -> None:
            nonlocal last
            if time.monotonic() - last >= _PRINT_EVERY_S:
                last = time.monotonic()
                report(line)

        yield now_and_then, report
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    console = Console(stderr=True, highlight=False, soft_wrap=True)
    with Live(console=console, auto_refresh=False, transient=True) as live:
        yield (
            lambda line: live.update(Text(line, no_wrap=True), refresh=True),
            lambda line: console.print(line, markup=False),
        )

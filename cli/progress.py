"""Progress: a bar on a terminal, and nothing elsewhere."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Report = Callable[[float, str, float], None]


@contextmanager
def progress_bar(unit: str) -> Iterator[Report | None]:
    """Show how far a training is, on standard error.

    Yields what takes the share of the work that is done, the stage and its error [unit]; None
    where standard error is no terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[error]}"),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task("babbling", total=1.0, error="")

        def report(share: float, stage: str, error: float) -> None:
            shown = f"error {error:.3g} {unit}" if math.isfinite(error) else ""
            bar.update(task, completed=share, description=stage, error=shown)

        yield report

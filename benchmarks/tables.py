"""Tables: what a script has measured, as Markdown for its page."""

import math
from collections.abc import Iterable
from typing import Any


def number(value: float) -> str:
    """Three digits, for a table."""
    if not math.isfinite(value) or (value and abs(value) < 1e-6):
        return "–" if not math.isfinite(value) else "< 1e-6"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def table(title: str, rows: Iterable[dict[str, Any]]) -> None:
    """Print rows of the same keys below a title."""
    rows = list(rows)
    if not rows:
        return
    print(f"\n{title}\n\n| " + " | ".join(rows[0]) + " |")
    print("|---|" + "---:|" * (len(rows[0]) - 1))
    for row in rows:
        cells = (number(v) if isinstance(v, float) else f"{v}" for v in row.values())
        print("| " + " | ".join(cells) + " |", flush=True)

"""What scripts share: the options that are typed, and tables as Markdown for a page."""

import argparse
import math
from collections.abc import Iterable
from typing import Any


def typed(doc: str, **options: Any) -> argparse.Namespace:
    """Options as typed, each by what it is without: False is a flag, a tuple the choices.

    A type stands for an option that is None without.
    """
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    for name, usual in options.items():
        if usual is False:
            how: dict[str, Any] = {"action": "store_true"}
        elif isinstance(usual, tuple):
            how = {"choices": usual}
        elif isinstance(usual, type):
            how = {"type": usual}
        else:
            how = {"type": type(usual), "default": usual}
        parser.add_argument(f"--{name}", **how)
    return parser.parse_args()


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

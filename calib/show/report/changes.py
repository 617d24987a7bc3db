"""Changes: adaptations that a model went through, and what a log says of it now."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..error_scale import length_in_words
from .tables import table

if TYPE_CHECKING:
    from ...change.check import Drift


def adaptation_table(history: Sequence[Mapping[str, Any]], unit: str) -> str:
    """Return mean (largest) distances before and after each adaptation, "" where none tells."""
    rows = []
    for state in history:
        before, after = state.get("before"), state.get("after")
        if not isinstance(before, Mapping) or not isinstance(after, Mapping):
            continue
        cells = [str(state.get("method", "")), f"{state.get('samples', '')}"]
        for errors in (before, after):
            mean, most = (
                length_in_words(float(errors.get(key) or 0.0), unit) for key in ("mean", "max")
            )
            cells.append(f"{mean} ({most})")
        rows.append(cells)
    if not rows:
        return ""
    return table(["adapted by", "rows", "before: mean (largest)", "after: mean (largest)"], rows)


def history_table(history: Sequence[Mapping[str, Any]]) -> str:
    """Return the earlier states of an adapted model, whatever facts they state."""
    rows = [dict(_flat(state)) for state in history]
    names = list(dict.fromkeys(name for row in rows for name in row))
    return table(
        ["fact", *(f"state {k + 1}" for k in range(len(rows)))],
        [[name.replace("_", " "), *(row.get(name, "") for row in rows)] for name in names],
    )


def drift_text(drift: Drift) -> str:
    """Return what the log that was given says: drifted or not, each signal, the causes."""
    verdict = "It has drifted." if drift.drifted else "No drift was found."
    told = "".join(f'<p class="soft">{html.escape(text)}</p>' for text in drift.explanations)
    rows = [
        [name, f"{signal.value:.3g}", f"{signal.threshold:.3g}", f"{signal.score:.2f}"]
        for name, signal in drift.distortion.items()
    ]
    header = ["distortion", "value", "threshold", "value over threshold"]
    return (
        f"<p>{verdict} {drift.samples:,} rows were compared, {drift.outliers:,} outliers "
        f"were left out.</p>{told}{table(header, rows)}"
    )


def _flat(state: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    """Names and values of nested facts, numbers with four digits."""
    for name, value in state.items():
        label = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{label}, ")
        elif value is None:
            continue
        elif isinstance(value, bool) or not isinstance(value, (int, float)):
            text = ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
            yield label, text[:200]
        else:
            yield label, f"{value:.4g}"

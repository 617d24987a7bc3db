"""The command `calib info`: show what a model is and how it was made."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calib.common.wording import printable
from calib.model.facts import facts

from ..options import takes
from ..output import fields, show, show_facts, show_json
from ..summary import compact_table, summary
from ..translation import as_typed

if TYPE_CHECKING:
    from calib import Model


@takes()
def info(model: str, degrees: bool = False, as_json: bool = False) -> None:
    """Show what a model is and how it was made."""
    import calib

    loaded = calib.load(model)
    if as_json:
        # a model knows no seconds: its bytes must not depend on the machine's pace
        show_json({**summary(loaded, model, loaded.about.errors, {}), **_provenance(loaded)})
        return
    show_facts(_facts(loaded, model, degrees))
    if loaded.body is not None:
        print("\nbody")
        for line in loaded.body.describe():
            print(f"  {printable(line)}")
    if loaded.about.errors:
        print()
        show(compact_table(loaded, loaded.about.errors, "errors when it was made"))


def _provenance(model: Model) -> dict[str, Any]:
    about = model.about
    return {
        "ranges": {
            name: [low, high]
            for name, low, high in zip(
                about.joint_names, about.lower.tolist(), about.upper.tolist(), strict=True
            )
        },
        "joint_units": dict(zip(about.joint_names, about.units_of_joints, strict=True)),
        **fields(about, "locked source simulation taught options"),
        **fields(model, "history"),
        "body": None if model.body is None else model.body.to_json(),
        "rows": 0 if model.rows is None else len(model.rows),
        "notes": [as_typed(text) for text in about.notes],
        "backlash": None if model.approach is None else (2.0 * model.approach.play).tolist(),
    }


def _facts(model: Model, path: str, degrees: bool) -> dict[str, str]:
    about = model.about
    found = {
        "model": f"{path} ({Path(path).stat().st_size / 1e6:.2f} MB)",
        **facts(model, degrees=degrees),
        **{f"note {k}": text for k, text in enumerate(about.notes, start=1)},
    }
    if model.approach is not None:
        half = zip(about.joint_names, model.approach.play, about.revolute, strict=True)
        found["backlash"] = ", ".join(
            # play is stored as the distance from the middle, and told from side to side
            f"{name} {2 * math.degrees(h):.3g} deg" if turns else f"{name} {2 * h:.3g} m"
            for name, h, turns in half
            if h > 0.0
        )
    if model.history:
        found["earlier states"] = str(len(model.history))
    return found

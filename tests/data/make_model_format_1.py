"""Write model-format-1.calib and what it answered when it was made.

It was run with the package of commit 3ea9410, the first with model format 1, and is kept to
show where the files come from. Run with a later one it would prove nothing.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np

import calib

HERE = Path(__file__).parent


def main() -> None:
    """Train a small model on a log whose sensor has a kink, which needs local models; ask it."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 900, seed=3, noise=0.0001)
    kink = 0.02 * np.abs(log.x[:, :1] - 0.2)
    log = dataclasses.replace(log, x=log.x + kink, simulation=None)
    model = calib.train(log, size=12, seed=3)
    model.save(HERE / "model-format-1.calib")
    q = np.random.default_rng(4).uniform(arm.lower, arm.upper, (20, 2))
    x = arm.forward(q)
    answers = {
        "q": q.tolist(),
        "x": x.tolist(),
        "forward": {r: model.forward(q, r).tolist() for r in ("local", "activity", "winner")},
        "inverse": model.inverse(x, near=q).tolist(),
        "expected_error": model.expected_error(q).tolist(),
        "local_degree": model.predictor.models.degree,
    }
    text = json.dumps(answers, indent=1)
    (HERE / "model-format-1.json").write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main()

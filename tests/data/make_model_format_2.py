"""Write model-format-2.calib and what it answered when it was made.

It was run with the first package with model format 2, and is kept to show where the files come
from. Run with a later one it would prove nothing.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np

import calib

HERE = Path(__file__).parent


def main() -> None:
    """Train a small model on what a tilted camera with a kink saw of a reversed, bent arm."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 400, seed=3)
    q = log.q + np.stack([0.004 * np.sin(9 * log.q[:, 0]), 0.002 * log.q[:, 1]], axis=1)
    seen = arm.forward(q)
    pixels = 900 * seen @ [[1.0, 0.1], [0.0, -1.0]] / (1 + 0.4 * seen[:, :1]) + [640, 480]
    pixels += 12 * np.abs(seen[:, :1] - 0.2)
    pixels += np.random.default_rng(5).normal(scale=0.1, size=pixels.shape)
    log = dataclasses.replace(log, x=pixels, unit="px", simulation=None)
    model = calib.train(log, size=12, seed=3)
    model.save(HERE / "model-format-2.calib")
    q = np.random.default_rng(4).uniform(arm.lower, arm.upper, (20, 2))
    x = model.forward(q)
    answers = {
        "q": q.tolist(),
        "x": x.tolist(),
        "forward": {r: model.forward(q, r).tolist() for r in model.readouts},
        "inverse": model.inverse(x, near=q).tolist(),
        "expected_error": model.expected_error(q).tolist(),
        "model_error": model.model_error(q).tolist(),
        "local_degree": model.predictor.models.degree,
        "member": model.body.member,
        "words": list(model.body.describe()),
    }
    text = json.dumps(answers, indent=1)
    (HERE / "model-format-2.json").write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main()

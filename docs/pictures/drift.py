"""Drift: the monitor's score while an arm is knocked and re-calibrated."""

from __future__ import annotations

import numpy as np

import calib

from .style import FIRST, GREY, INK, SECOND, THIRD, panels, save

CALM, KNOCKED = 300, 120  # samples before and after the knock
NOISE = 1e-3  # [m]


def drift() -> None:
    """Score of a stream: calm, an elbow encoder that slips by 1 deg, adapted, calm again."""
    arm = calib.load_arm("two_link")
    model = calib.train(calib.babble(arm, 20_000, seed=0, noise=NOISE), size=40)
    slipped = [f"elbow.offset={np.radians(1):.5f}"]
    calm = calib.babble(arm, CALM, seed=1, noise=NOISE)
    knocked = calib.babble(arm, KNOCKED, seed=2, noise=NOISE, changes=slipped)
    after = calib.babble(arm, CALM, seed=3, noise=NOISE, changes=slipped)
    monitor = calib.monitor(model)
    score = [monitor.update(q, x).score for q, x in zip(calm.q, calm.x, strict=True)]
    score += [monitor.update(q, x).score for q, x in zip(knocked.q, knocked.x, strict=True)]
    alarm = next(k for k, value in enumerate(score) if value > 1)
    renewed = calib.monitor(calib.adapt(model, knocked).model)
    score += [renewed.update(q, x).score for q, x in zip(after.q, after.x, strict=True)]
    figure, (ax,) = panels(1, 2.9)
    step = np.arange(1, len(score) + 1)
    for part, colour in (
        (slice(0, CALM), FIRST),
        (slice(CALM, CALM + KNOCKED), SECOND),
        (slice(CALM + KNOCKED, None), THIRD),
    ):
        shown = np.array(score[part])
        ax.plot(step[part], np.where(shown > 0, shown, np.nan), color=colour, linewidth=1.8)
    ax.axhline(1, color=INK, linewidth=0.8, linestyle="--")
    ax.set(xlabel="sample", ylabel="score", ylim=(0, 5), xlim=(0, len(score)))
    for at, text in (
        (CALM, f"the encoder slips;\nalarm {alarm + 1 - CALM} samples later"),
        (CALM + KNOCKED, f"adapted with the\n{KNOCKED} samples since"),
    ):
        ax.axvline(at, color=GREY, linewidth=1)
        ax.annotate(
            text,
            (at, 0.98),
            xycoords=("data", "axes fraction"),
            xytext=(6 if at > CALM else -6, 0),
            textcoords="offset points",
            va="top",
            ha="left" if at > CALM else "right",
        )
    ax.annotate(
        "threshold", (len(score), 1), xytext=(-4, 4), textcoords="offset points", ha="right"
    )
    save(figure, "drift")

"""Readout: a body, what local models add to it, and the bound on what is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import calib

from .style import FAINT, FIRST, GREY, INK, SCALE, SECOND, panels, plane, save

RIPPLE, TEETH = np.radians(0.4), 24.0  # of the elbow's gear: amplitude [rad], per turn
SLICE = 0.3  # of the shoulder [rad]


def local() -> None:
    """An elbow whose gear ripples with the shoulder: the body misses it, local models do not."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 20_000, seed=0)
    x = _rippled(arm, log.q) + np.random.default_rng(1).normal(0, 3e-4, log.x.shape)
    model = calib.train(replace(log, x=x, simulation=None), size=40)
    elbow = np.linspace(arm.lower[1], arm.upper[1], 400)[8:-8]
    q = np.stack([np.full(len(elbow), SLICE), elbow], axis=1)
    body = model.forward(q, "body")
    truth = 1e3 * (_rippled(arm, q) - body)[:, 0]
    added = 1e3 * (model.forward(q) - body)[:, 0]
    near = np.abs(log.q[:, 0] - SLICE) < 0.02
    rest = 1e3 * (x[near] - model.forward(log.q[near], "body"))
    figure, (whole, left) = panels(2, 3.0)
    degrees = np.degrees(elbow)
    whole.plot(degrees, 1e3 * body[:, 0], color=INK, linewidth=1.6)
    whole.set(xlabel="elbow [deg]", ylabel="x [mm]", title="the body")
    left.plot(
        np.degrees(log.q[near, 1]), rest[:, 0], ".", color=GREY, markersize=3, label="samples"
    )
    left.plot(degrees, truth, color=FIRST, linewidth=2.6, alpha=0.5, label="truth")
    left.plot(degrees, added, color=SECOND, linewidth=1.4, label="local models")
    left.set(xlabel="elbow [deg]", ylabel="x less body [mm]", title="what the body leaves over")
    left.legend(ncols=3, loc="upper center", handlelength=1.2, columnspacing=1.0)
    left.set_ylim(top=1.55 * max(truth.max(), rest[:, 0].max()))
    save(figure, "local")


def _rippled(arm: calib.PlanarArm, q: np.ndarray) -> np.ndarray:
    ripple = RIPPLE * np.sin(TEETH * q[:, 1]) * np.cos(2 * q[:, 0])
    return arm.forward(q + ripple[:, None] * [0.0, 1.0])


def bounds() -> None:
    """Bounds over the workspace of a log of 150 rows, and what they bound: fresh readings."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 150, seed=4, noise=1e-3)
    model = calib.train(replace(log, simulation=None))
    fresh = calib.babble(arm, 6000, seed=5, noise=1e-3)
    q = fresh.q
    error = np.linalg.norm(model.forward(q) - fresh.x, axis=1)
    bound = model.expected_error(q)
    known = np.isfinite(error) & np.isfinite(bound)
    error, bound, q = error[known], bound[known], q[known]
    figure, (space, shares) = panels(2, 3.5, width_ratios=[1.15, 1])
    dots = space.scatter(*(1e3 * arm.forward(q)).T, c=1e3 * bound, cmap=SCALE, s=5)
    space.plot(*(1e3 * log.x).T, "o", color="white", markersize=3.5, markeredgecolor="black")
    plane(space, "150 rows, 1 mm of noise: the bound")
    figure.colorbar(dots, ax=space, label="expected error [mm]", shrink=0.85)
    ratio = error / bound
    inside = float(np.mean(ratio <= 1))
    shares.hist(np.clip(ratio, 0, 2), bins=np.linspace(0, 2, 41), color=FIRST)
    shares.axvline(1, color=SECOND, linewidth=2)
    shares.annotate(
        f"{100 * inside:.1f} % are\nwithin the bound",
        (1, 0.8),
        xycoords=("data", "axes fraction"),
        xytext=(8, 0),
        textcoords="offset points",
    )
    shares.grid(axis="y", color=FAINT, linewidth=0.5)
    shares.set(xlabel="error / expected error", ylabel="readings", title="6,000 fresh readings")
    save(figure, "bounds")

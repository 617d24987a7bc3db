"""Learning: how a map unfolds, what a winner takes along, where nodes are dense."""

from __future__ import annotations

import numpy as np

import calib

from .style import FIRST, GREY, SCALE, edge_means, lattice, panels, plane, save

SIDE, EPOCHS, START, END = 20, 20, 10.0, 1.0  # nodes, passes, radii [nodes]
SHOWN = (1, 5, 9, 13, 20)


def learning() -> None:
    """A plain map of the positions after some of its twenty epochs.

    The first k epochs of a training are a training of k epochs that ends at their radius.
    """
    log = calib.babble(calib.load_arm("two_link"), 5000, seed=0)
    figure, axes = panels(len(SHOWN), 1.75, sharex=True, sharey=True)
    for ax, epoch in zip(axes, SHOWN, strict=True):
        radius = START * (END / START) ** ((epoch - 1) / (EPOCHS - 1))
        som = calib.SOM((SIDE, SIDE), map="som", epochs=epoch, sigma=(START, radius)).fit(log.x)
        ax.plot(*(1e3 * log.x[::10]).T, ".", color="#e7ebee", markersize=2)
        lattice(ax, som, 1e3, color=FIRST, linewidths=0.6)
        ax.set(title=f"epoch {epoch}\nradius {radius:.1f}", aspect="equal", xlabel="x [mm]")
    axes[0].set_ylabel("y [mm]")
    save(figure, "learning")


def winner() -> None:
    """Share of a sample's pull that each node of a map takes, at three radii."""
    log = calib.babble(calib.load_arm("two_link"), 5000, seed=0)
    som = calib.SOM((SIDE, SIDE), map="som").fit(log.x)
    sample = np.array([0.30, 0.35])
    best = int(np.linalg.norm(som.weights - sample, axis=1).argmin())
    place = np.stack(np.divmod(np.arange(som.size), SIDE), axis=1)
    figure, axes = panels(3, 2.1, sharex=True, sharey=True)
    for ax, sigma in zip(axes, (5.0, 2.0, 1.0), strict=True):
        h = np.exp(-np.sum((place - place[best]) ** 2, axis=1) / (2 * sigma**2))
        lines = lattice(ax, som, 1e3, linewidths=0.5)
        dots = ax.scatter(*(1e3 * som.weights).T, c=h, cmap=SCALE.reversed(), s=9, vmin=0, vmax=1)
        ax.plot(*(1e3 * sample), "*", color="white", markeredgecolor="black", markersize=9)
        lines.set_color("#e0e4e8")
        plane(ax, f"radius {sigma:.0f} nodes")
    figure.colorbar(dots, ax=list(axes), label="h, share of the pull", shrink=0.8)
    save(figure, "winner")


def density() -> None:
    """A plain and a varying-density map after the same schedule, with the workspace's border."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 20_000, seed=0)
    figure, axes = panels(2, 3.0, sharex=True, sharey=True)
    border = 1e3 * arm.forward(_around(arm.lower, arm.upper))
    for ax, (kind, title) in zip(
        axes, (("som", "plain map"), ("vdsom", "varying density")), strict=True
    ):
        som = calib.SOM((30, 30), map=kind, epochs=30, sigma=(15.0, 2.0)).fit(log.x)
        gap = 1e3 * som.spacings * som.scale.span.mean()
        ax.plot(*border.T, color=GREY, linewidth=1.2)
        lines = lattice(
            ax, som, 1e3, array=edge_means(som, gap), cmap=SCALE, clim=(5, 20), color=None
        )
        plane(ax, title)
    figure.colorbar(lines, ax=list(axes), label="distance of neighbours [mm]", shrink=0.8)
    save(figure, "density")


def _around(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Joint values along the border of the box of two joints."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)
    way = np.linspace(0, 4, 401)
    unit = np.stack([np.interp(way, np.arange(5), corners[:, k]) for k in range(2)], axis=1)
    return lower + unit * (upper - lower)

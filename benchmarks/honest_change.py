"""Honesty about change: what `adapt` does where no row was measured."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from honest_real import SERIES, halves, nominal_urdf, series
from honest_worlds import LENGTHS, Row, distance, flexed, image, lens, row, samples, tilted, tip

import calib

Array = Any

PIXEL = 1.2 / 900.0
"""What a pixel of the camera in honest_worlds is worth on the plane, nearly [m]."""


@dataclass(frozen=True)
class Trial:
    """One real adaptation, judged on the rows that it did not see.

    Attributes
    ----------
    same : bool
        Whether the arm and the sensor were those of the training.
    ratio : float
        Mean error after over before.
    covered : float
        Share of the answered rows within the bound.
    kept : bool
        Whether the model was left as it was, bit for bit.
    """

    same: bool
    ratio: float
    covered: float
    kept: bool


def adapted(
    model: calib.Model, log: calib.Samples, n: int, place: int, same: bool, every: int = 1
) -> Trial:
    """Adapt with n contiguous rows at one of ten places, asked at some or all of the others."""
    start = (len(log) - n) * place // 9
    used = np.arange(start, start + n)
    rest = log.take(np.setdiff1d(np.arange(len(log)), used)[::every])
    found = calib.adapt(model, log.take(used))
    after, before = found.model.forward(rest.q), model.forward(rest.q)
    print(".", end="", file=sys.stderr, flush=True)
    kept = bool(np.array_equal(after, before, equal_nan=True))
    both = np.isfinite(after).all(axis=1) & np.isfinite(before).all(axis=1)
    miss = distance(after, rest.x)
    ratio = float(miss[both].mean() / distance(before, rest.x)[both].mean())
    inside = float(np.mean(miss[both] <= found.model.expected_error(rest.q)[both]))
    return Trial(same, ratio, inside, kept)


def adaptations(folder: Path, quick: bool) -> Iterator[Row]:
    """A -> C, C -> A and halves of each, with 40, 150 and 400 contiguous rows."""
    a, c = (series(folder, name) for name in SERIES)
    # one range for both: a model answers nowhere else
    lower, upper = np.minimum(a.lower, c.lower), np.maximum(a.upper, c.upper)
    a, c = (replace(log, lower=lower, upper=upper) for log in (a, c))
    pairs = [(a, c, False), (c, a, False)]
    for log in (c, a):
        first, second = np.array_split(np.arange(len(log)), 2)
        pairs += [(log.take(first), log.take(second), True)]
        pairs += [(log.take(second), log.take(first), True)]
    trials = []
    for before, after, same in pairs[: 3 if quick else None]:
        model = calib.train(before)
        for n in (40, 400) if quick else (40, 150, 400):
            for place in range(1, 10, 4) if quick else range(10):
                trials.append(adapted(model, after, n, place, same))
    yield from judged_trials("adaptations", trials)


def judged_trials(what: str, trials: list[Trial]) -> Iterator[Row]:
    """The bars of adaptations, in the plane and in space."""
    ratio = np.array([t.ratio for t in trials])
    changed = [t for t in trials if not t.same]
    same = [t for t in trials if t.same]
    moved = [t for t in trials if not t.kept]
    yield row(
        f"{what}: {len(trials)}, worst error after / before",
        float(ratio.max()),
        most=1.12,
        more="largest: " + ", ".join(f"{r:.2f}" for r in np.sort(ratio)[-6:]),
    )
    yield row("share of them above 1.05", 100 * float(np.mean(ratio > 1.05)), "%", most=5)
    yield row(
        f"unchanged halves left bit for bit, of {len(same)}",
        100 * float(np.mean([t.kept for t in same])),
        "%",
        least=87.5,
    )
    yield row(
        f"mean ratio of the changed, {len(changed)}",
        float(np.mean([t.ratio for t in changed])) if changed else float("nan"),
        most=0.8,
    )
    if not moved:
        return
    yield row(
        f"coverage on the rest after an adaptation, mean of {len(moved)}",
        100 * float(np.mean([t.covered for t in moved])),
        "%",
        least=85,
        more=f"least {100 * min(t.covered for t in moved):.0f}",
    )


def places(quick: bool) -> Iterator[Row]:
    """A shifted sensor, seen from 24 rows of one place: bounds, and the interval of its turn."""
    arm, shift = calib.load_arm("two_link"), np.array([0.3, -0.2])

    def seen(q: np.ndarray, seed: int, moved: bool) -> calib.Samples:
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(q.shape)
        return samples(q, arm.forward(q) + noise + moved * shift, arm.lower, arm.upper, arm=arm)

    def box(n: int, seed: int) -> np.ndarray:
        return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, 2))

    asked = box(500, 99)
    models = [calib.train(seen(box(n, 0), 0, moved=False)) for n in (40, 400)]
    for half in (0.006, 0.03, 0.2):
        shares, held, halves, answered = [], [], [], []
        for model in models:
            for seed in range(100, 103 if quick else 112):
                rng = np.random.default_rng(seed)
                log = seen(
                    np.array([0.5, 1.2]) + rng.uniform(-half, half, (24, 2)), seed, moved=True
                )
                found = calib.adapt(model, log)
                miss = distance(found.model.forward(asked), arm.forward(asked) + shift)
                bound = found.model.model_error(asked)
                known = np.isfinite(bound)
                shares.append(float(np.mean(miss[known] <= bound[known])))
                answered.append(float(known.mean()))
                low, high = next(c.interval for c in found.changed if c.cause == "sensor")
                held.append(low < 0.0 < high)
                halves.append(float(np.degrees(high - low)) / 2)
        yield row(
            f"shifted sensor, 24 rows within {half:g} rad: coverage",
            100 * float(np.mean(shares)),
            "%",
            least=93,
            more=(
                f"least {100 * min(shares):.0f}, answered {100 * np.mean(answered):.0f} %; "
                f"turn +- {np.median(halves):.2g} deg, holds 0 in {sum(held)} of {len(held)}"
            ),
        )


CHANGES: dict[str, tuple[Any, float, float]] = {
    # what: (joints -> measured position, bar exact [mm], bar at 1 mm [mm])
    "length": (lambda q: tip(q, (0.30, 0.30)), 0.001, 0.30),
    "both": (lambda q: tip(q, (0.27, 0.20)), 0.001, 0.30),
    "camera": (
        lambda q: 1.05 * tip(q + np.array([0.139626, 0.0]), LENGTHS[2]) + np.array([0.03, 0.0]),
        0.001,
        0.30,
    ),
    "encoders": (lambda q: tip(q + np.radians([3.0, -2.0]), LENGTHS[2]), 0.001, 0.30),
    "mirror": (lambda q: tip(q, LENGTHS[2]) * np.array([-1.0, 1.0]), 0.001, 0.30),
    "gear 3 %": (lambda q: tip(q * np.array([1.0, 1.03]), LENGTHS[2]), 0.001, 0.30),
    "flexion": (lambda q: tip(flexed(q), LENGTHS[2]), 0.001, 0.45),
    "lens": (lambda q: lens(tip(q, LENGTHS[2])), 0.02, 0.50),
    "tilted camera": (lambda q: tilted(tip(q, LENGTHS[2])), 0.001, 0.45),
    "pixels": (lambda q: image(tip(q, LENGTHS[2])), 0.001, 0.45),
}


@cache
def _exact(n: int) -> calib.Model:
    return calib.train(
        calib.babble(calib.load_arm("two_link"), n, seed=0), size=70 if n > 9000 else 30
    )


def changed(quick: bool) -> Iterator[Row]:
    """Mean error over the workspace after 100 rows of a changed arm or sensor."""
    arm, model = calib.load_arm("two_link"), _exact(4000 if quick else 20_000)
    asked = np.random.default_rng(9).uniform(arm.lower, arm.upper, (2000, 2))
    covers = {}
    for noise in (0.0, 1e-3):
        for name, (truth, exact, noisy) in CHANGES.items():
            size = PIXEL if name == "pixels" else 1.0
            errors, shares = [], []
            for seed in range(1 if quick else 5):
                rng = np.random.default_rng(300 + seed)
                q = rng.uniform(arm.lower, arm.upper, (100, 2))
                x = truth(q) + noise / size * rng.standard_normal((100, 2))
                unit = "px" if name == "pixels" else "m"
                log = samples(q, x, arm.lower, arm.upper, arm=arm, unit=unit)
                found = calib.adapt(model, log).model
                miss = distance(found.forward(asked), truth(asked))
                bound = found.model_error(asked)
                known = np.isfinite(miss) & np.isfinite(bound)
                errors.append(1e3 * size * float(miss[known].mean()))
                shares.append(float(np.mean(miss[known] <= bound[known])))
            yield row(
                f"100 rows after {name}, {'1 mm' if noise else 'exact'}",
                float(np.mean(errors)),
                "mm",
                most=noisy if noise else exact,
                more=f"covers {100 * np.mean(shares):.0f} %, worst seed {max(errors):.3g}",
            )
            covers[name, noise] = 100 * float(np.mean(shares))
    noisy = {name: share for (name, noise), share in covers.items() if noise}
    yield row(
        "coverage after a change at 1 mm, mean",
        float(np.mean(list(noisy.values()))),
        "%",
        least=83,
        more=f"with the exact ones {np.mean(list(covers.values())):.0f}",
    )
    yield row(
        f"the same, least ({min(noisy, key=lambda n: noisy[n])})",
        min(noisy.values()),
        "%",
        least=60,
    )


SPARSE = 373
"""Rows of a sparse model, nearly: much of the joints' waves is then left to learn."""


@cache
def space(folder: Path, name: str) -> calib.Samples:
    """One series with orientations, for the UR10's URDF."""
    return calib.read_log(folder / f"full_{name}.csv", calib.load_arm(nominal_urdf()))


def space_adaptations(folder: Path, quick: bool) -> Iterator[Row]:
    """Odd blocks after even ones, and A after C: 40, 150 and 400 contiguous rows, ten places.

    Of each series a model of all rows and one of few, each with positions alone and with
    orientations.
    """
    trials: list[Trial] = []
    for name in SERIES[: 1 if quick else None]:
        log = space(folder, name)
        other = space(folder, SERIES[1 - SERIES.index(name)])
        even, odd = halves(len(log), 10)[0]
        few = even[:: max(1, len(even) // SPARSE)]
        for posed in (False, True):
            for learned in (few,) if quick else (even, few):
                model = calib.train(_seen(log.take(learned), posed))
                trials += _trials(model, _seen(log.take(odd), posed), True, quick)
                if not posed and (quick or len(learned) == len(even)):
                    trials += _trials(model, _seen(other, posed), False, quick)
    yield from judged_trials("in space", trials)


def _seen(log: calib.Samples, posed: bool) -> calib.Samples:
    return log if posed else replace(log, orientation=None)


def _trials(model: calib.Model, log: calib.Samples, same: bool, quick: bool) -> Iterator[Trial]:
    """Every size at ten places of a log."""
    for n in (150,) if quick else (40, 150, 400):
        for place in range(0, 10, 9 if quick else 1):
            yield adapted(model, log, n, place, same, every=10)

"""The online rule: the paper's equations, and that it agrees with batch."""

import numpy as np
import pytest

import calib
from calib.maps.lattice import Lattice
from calib.maps.online import present_online
from calib.paper.setting import Setting
from calib.paper.trial import Schedule, activity_errors, association


def test_a_step_is_eq_1_to_3_whatever_the_lattice():
    for shape in ((9,), (7, 8), (4, 5, 3)):
        rng = np.random.default_rng(0)
        lattice = Lattice(shape)
        w, x = rng.random((lattice.size, 2)), rng.random((5, 2))
        sigma, rate = np.linspace(3.0, 2.0, 5), np.linspace(0.5, 5.0, 5)
        wanted, distances = w.copy(), []
        for sample, s, a in zip(x, sigma, rate, strict=True):
            away = np.linalg.norm(wanted - sample, axis=1)
            winner = away.argmin()
            distances.append(away[winner])
            r = lattice.positions()
            h = np.exp(-np.sum((r - r[winner]) ** 2, axis=1) / (2 * s * s))
            wanted += np.minimum(a * h, 1.0)[:, None] * (sample - wanted)
        found = present_online(w, lattice, x, sigma, rate)
        np.testing.assert_allclose(w, wanted, atol=5 * 5.0 * np.exp(-8.0))
        np.testing.assert_allclose(found, distances, atol=5 * 5.0 * np.exp(-8.0))


def test_online_and_batch_are_equally_precise_on_the_papers_arm():
    """The same schedule, three seeds each: no further apart than seeds are, or a tenth."""
    found = {}
    for rule in ("batch", "online"):
        errors = []
        for seed in (0, 1, 2):
            log = calib.babble(calib.load_arm("two_link"), 3000, seed=seed)
            pair = association(log, "som", Schedule(8, 0.8, rule=rule), 12, seed)
            errors.append(activity_errors(pair, *Setting().validation(log, seed, 3000)).mean())
        found[rule] = np.array(errors)
    a, b = found["batch"], found["online"]
    assert abs(a.mean() - b.mean()) < max(2 * np.hypot(a.std(), b.std()), 0.1 * a.mean())


@pytest.mark.parametrize("side", [6, 8, 16])
def test_a_varying_density_helps_small_lattices_too(side):
    """At one strength for all sizes it tore a lattice of 8x8, and the map was useless."""
    q = calib.babble(calib.load_arm("two_link"), 3000, seed=0).q

    def none(visit: calib.Visit):
        return np.ones(len(visit.winners))

    plain, varying = (
        calib.SOM((side, side), network, rule="online").fit(q).history[-1, 2:]
        for network in (none, "vdsom")
    )
    assert varying[0] < plain[0]  # distance to the winner
    assert varying[1] < 0.02  # topographic error

"""Functions of one's own in a map, and what becomes of wrong answers."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib.errors import LogError, OptionError
from calib.maps.lattice import Lattice
from calib.maps.neighbourhood import spread, spread_by

X = np.random.default_rng(0).uniform(size=(600, 2))
Q = np.random.default_rng(1).uniform(size=(600, 2))


def gauss(around: calib.Surroundings):
    return np.exp(-(around.distance**2) / (2.0 * around.sigma**2))


def test_the_gaussian_as_a_function_is_equation_3():
    lattice, sums = Lattice((7, 5)), np.random.default_rng(2).uniform(size=(35, 3))
    from calib.maps.fields import neighbourhood_values

    h = neighbourhood_values(gauss, lattice, 0.8, 0.5)
    assert h.shape == (13, 9)
    np.testing.assert_allclose(
        spread_by(sums, lattice, h), spread(sums, lattice, 0.8), rtol=2e-3, atol=1e-12
    )
    # without the cut at four sigma: by hand
    r = lattice.positions()
    full = np.exp(-((r[:, None] - r[None]) ** 2).sum(axis=2) / (2 * 0.8**2))
    np.testing.assert_allclose(spread_by(sums, lattice, h), full @ sums, rtol=1e-10)


def test_online_the_gaussian_moves_the_nodes_as_the_built_in_one_does():
    ours, theirs = (
        calib.SOM(6, "som", rule="online", epochs=1, sigma=(0.7, 0.5), neighbourhood=h).fit(X)
        for h in (gauss, None)
    )
    np.testing.assert_allclose(ours.units, theirs.units, atol=2e-2)


@pytest.mark.parametrize("rule", ["batch", "online"])
def test_a_neighbourhood_of_ones_own_trains(rule):
    bubble = calib.SOM(
        (6, 6), "som", rule, epochs=6, neighbourhood=lambda a: 1.0 * (a.distance <= a.sigma)
    ).fit(X)
    plain = calib.SOM((6, 6), "som", rule, epochs=6).fit(X)
    assert bubble.quantization_error(X) < 1.6 * plain.quantization_error(X)
    assert not np.array_equal(bubble.units, plain.units)


def test_a_gain_draws_nodes():
    def right(visit: calib.Visit):
        assert visit.weights.shape == (64, 2)
        return 1.0 + 20.0 * visit.progress * (visit.weights[visit.winners, 0] > 0.7)

    drawn = calib.SOM((8, 8), map=right).fit(X)
    plain = calib.SOM((8, 8), map="som").fit(X)
    assert (drawn.units[:, 0] > 0.7).sum() > 1.3 * (plain.units[:, 0] > 0.7).sum()


WRONG = {
    "shape": lambda n: np.ones(n + 1),
    "a scalar": lambda n: 1.0,
    "negative": lambda n: np.where(np.arange(n) == 3, -1.0, 1.0),
    "nan": lambda n: np.full(n, np.nan),
    "infinite": lambda n: np.full(n, np.inf),
    "zeros": np.zeros,
    "text": lambda n: "gain",
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
@pytest.mark.parametrize("rule", ["batch", "online"])
def test_a_gain_that_makes_no_sense_is_an_error(wrong, rule):
    som = calib.SOM((4, 4), map=lambda visit: wrong(len(visit.winners)), rule=rule, epochs=2)
    with pytest.raises(OptionError, match="gain returned"):
        som.fit(X)


@pytest.mark.parametrize("wrong", [WRONG[n] for n in ("shape", "negative", "nan", "text")])
@pytest.mark.parametrize("rule", ["batch", "online"])
def test_a_neighbourhood_that_makes_no_sense_is_an_error(wrong, rule):
    def h(around):
        found = wrong(around.distance.size)
        fits = isinstance(found, np.ndarray) and found.size == around.distance.size
        return found.reshape(around.distance.shape) if fits else found

    som = calib.SOM((4, 4), "som", rule, epochs=2, neighbourhood=h)
    with pytest.raises(OptionError, match="neighbourhood returned"):
        som.fit(X)
    with pytest.raises(OptionError, match="0 at the winner"):
        calib.SOM(
            (4, 4), "som", rule, epochs=1, neighbourhood=lambda a: 1.0 * (a.distance > 0)
        ).fit(X)


def test_a_rule_of_the_links_by_hand():
    """Eq. 5 at rest, for nodes that were active often, is one division."""
    by_name = calib.SOM((5, 5), "som", links="local").fit_pair(Q, Q**2)
    by_hand = calib.SOM((5, 5), "som", links=lambda p: p.together / p.sensory).fit_pair(Q, Q**2)
    np.testing.assert_allclose(
        by_hand.association.links.toarray(), by_name.association.links.toarray(), rtol=1e-3
    )
    model = calib.train(
        calib.babble(calib.load_arm("two_link"), 800), size=8, links=lambda p: p.together / p.motor
    )
    assert model.links.nnz > 0
    assert np.isfinite(model.forward([0.5, 1.0], "activity")).all()
    with pytest.raises(OptionError, match="link rule returned"):
        calib.SOM((4, 4), "som", links=lambda p: -p.together).fit_pair(Q, Q)
    with pytest.raises(OptionError, match="batch"):
        calib.SOM((4, 4), "som", "online", links=lambda p: p.together).fit_pair(Q, Q)


def test_a_model_with_a_rule_of_ones_own_is_stored(tmp_path):
    def product(pairs):
        return pairs.together

    model = calib.train(calib.babble(calib.load_arm("two_link"), 800), size=8, links=product)
    model.save(tmp_path / "m.calib")
    loaded = calib.load(tmp_path / "m.calib")
    assert loaded.about.options["links"] == "product"
    assert np.allclose(loaded.links.toarray(), model.links.toarray())


def test_maps_and_links_develop_together():
    pair = calib.SOM((9, 9), "som", "online", epochs=7).fit_pair(Q, Q**2)
    samples, sigma, motor, sensory, error = pair.curve.T
    assert samples[-1] == 4200
    assert (np.diff(sigma) <= 0).all()
    assert motor[-1] < motor[0]
    assert sensory[-1] < sensory[0]
    assert error[-1] < 0.4 * np.nanmax(error)
    fresh = np.random.default_rng(5).uniform(0.1, 0.9, (200, 2))
    gap = np.linalg.norm(pair.forward(fresh) - fresh**2, axis=1)
    assert gap.mean() < 0.08
    again = calib.SOM((9, 9), "som", "online", epochs=7).fit_pair(Q, Q**2)
    assert np.array_equal(pair.curve, again.curve, equal_nan=True)


def test_a_gas_stops_at_its_error():
    sizes = []
    for error in (0.10, 0.05):
        gas = calib.SOM((400,), map="gng", error=error).fit(X)
        assert gas.history[-1, 2] <= error
        sizes.append(gas.size)
    assert 2 < sizes[0] < sizes[1] < 400
    # about as many as a quantizer of that error needs: 0.38 sqrt(1 / n)
    assert sizes[1] < 3 * (0.38 / 0.05) ** 2


def test_what_cannot_be():
    with pytest.raises(OptionError, match="growing neural gas stops"):
        calib.SOM((4, 4), error=0.1)
    with pytest.raises(OptionError, match="0 to 1"):
        calib.SOM((4, 4), map="gng", error=2.0)
    with pytest.raises(OptionError, match="neighbourhood of its own"):
        calib.SOM((4, 4), map="gng", neighbourhood=gauss)
    with pytest.raises(OptionError, match="links 'hebb'"):
        calib.SOM((4, 4), links="hebb")
    with pytest.raises(LogError, match="shapes"):
        calib.SOM((4, 4)).fit_pair(Q, X[:5])
    with pytest.raises(OptionError, match="a Hebbian link for every pair"):
        calib.SOM(110, rule="online").fit_pair(Q, Q)

"""Training refuses impossible options, too few rows, joints that stood still and folded maps."""

import numpy as np
import pytest
from models import log, two_link

import calib
from calib.errors import LogError, OptionError


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": 0}, "size 0x0: a lattice needs at least 2"),
        ({"size": 100_000}, "10,000,000,000 nodes are more than"),
        ({"size": 7.5}, "expected whole numbers"),
        ({"size": "70x"}, "expected whole numbers"),
        ({"size": (5, 5, 5)}, "5x5x5: expected at most 2 numbers"),
        ({"sensory_size": (5, 5, 5)}, "sensory size 5x5x5: expected at most 2 numbers"),
        ({"seed": -1}, "seed -1: expected a whole number"),
        ({"map": "vsom"}, "map 'vsom' is unknown, choose one of"),
        ({"rule": "magic"}, "rule 'magic' is unknown, choose one of batch, online"),
        ({"body": "some"}, "body 'some': expected one of auto, none"),
        ({"view": "sideways"}, "view 'sideways': expected one of auto, base, rigid"),
        ({"view": "base"}, "view 'base' needs a measured log and the planar robot"),
    ],
)
def test_impossible_options_are_refused_in_one_line(options, message):
    samples = calib.babble(calib.load_arm("two_link"), 200)
    with pytest.raises(OptionError, match=message) as caught:
        calib.train(samples, **{"size": 5, **options})
    assert "\n" not in str(caught.value)


def test_too_few_rows_are_refused_and_ten_are_enough():
    with pytest.raises(LogError, match="9 samples are too few to learn from: give at least 10"):
        calib.train(log(9), size=4)
    assert calib.train(log(10), size=4).about.samples == 10


def test_a_joint_that_never_moved_is_refused_or_ignored():
    s = log(200)
    q = s.q.copy()
    q[:, 1] = 1.0
    still = calib.Samples(q, two_link(q), s.joint_names, s.lower, s.upper, s.revolute)
    model = calib.train(still, size=8)
    along = np.stack([np.linspace(0.1, 1.4, 20), np.ones(20)], axis=1)
    np.testing.assert_allclose(model.forward(along), two_link(along), atol=1e-4)
    assert np.isnan(model.forward([0.5, 2.0])).all()
    # beside the rows the bound tells where the answers end, in batches and one by one
    beside = np.stack([np.full(81, 0.5), 1.0 + np.linspace(-0.05, 0.05, 81)], axis=1)
    bound, x = model.model_error(beside), model.forward(beside)
    error = np.linalg.norm(x - two_link(beside), axis=1)
    known = np.isfinite(bound)
    assert 2 < np.count_nonzero(known) < 80
    assert (bound[known] <= 0.1 * model.reach).all()
    assert (error[known] <= bound[known]).all()
    np.testing.assert_array_equal(known, np.isfinite(x).all(axis=1))
    np.testing.assert_allclose([model.forward(q) for q in beside], x, atol=1e-12)
    np.testing.assert_allclose([model.model_error(q) for q in beside], bound, rtol=1e-9)


def test_maps_that_did_not_unfold_are_refused_in_one_line():
    samples = calib.babble(calib.load_arm("two_link"), 100, seed=0)
    with pytest.raises(OptionError, match=r"map.*`size`"):
        calib.train(samples, size=4, map="som", epochs=3, sigma=(1e9, 1e9))

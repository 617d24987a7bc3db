"""Without a body a log's held-out blocks choose between a lattice and a gas."""

import itertools

import numpy as np
import pytest

import calib
from calib.maps.lattice import Graph
from calib.training.learn import resolved


@pytest.fixture(scope="module")
def paths():
    """A log that repeats straight paths between random places; they cross in the workspace."""
    arm = calib.load_arm("two_link")
    rng = np.random.default_rng(0)
    ends = rng.uniform(arm.lower, arm.upper, (13, 2))
    t = np.linspace(0.0, 1.0, 20)[:, None]
    once = np.concatenate([a + t * (b - a) for a, b in itertools.pairwise(ends)])
    q = np.tile(once, (5, 1)) + rng.uniform(-5e-3, 5e-3, (5 * len(once), 2))
    q = np.clip(q, arm.lower, arm.upper)
    x = arm.forward(q) + rng.normal(scale=2e-4, size=q.shape)
    return calib.Samples(q, x, arm.joint_names, arm.lower, arm.upper, arm.revolute, arm=arm)


def test_a_log_of_repeated_paths_has_a_gas_and_the_user_is_told(paths):
    model = calib.train(paths, size=8, body="none")
    assert isinstance(model.motor.lattice, Graph)
    assert model.about.options["map"] == "gas"
    assert any("without a lattice (gas)" in note for note in model.about.notes)
    # by the arm itself, which no choice has seen, it was right
    sheet = calib.train(paths, size=8, body="none", map="vdsom:residual")
    true = paths.arm.forward(paths.q)
    miss = [np.linalg.norm(m.forward(paths.q) - true, axis=1) for m in (model, sheet)]
    assert np.nanmean(miss[0]) < 0.8 * np.nanmean(miss[1])


@pytest.mark.parametrize(
    "given", [{"body": "auto"}, {"sigma": (2.0, 0.5)}, {"epochs": 3}, {"rule": "online"}]
)
def test_a_body_or_a_schedule_of_the_user_leaves_the_lattice(paths, given):
    options = calib.TrainingOptions(8, **{"body": "none", **given})
    found, notes = resolved(paths, options)
    assert (found.map, found.shapes, notes) == ("vdsom:residual", ((8, 8), (8, 8)), [])

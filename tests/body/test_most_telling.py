"""Most telling poses: the greedy gain of information, against what direct algebra says."""

import numpy as np
import pytest

from calib.body import body_fit
from calib.body.information import most_telling
from calib.body.planar import planar_structure
from calib.body.rows import Rows


@pytest.fixture(scope="module")
def body():
    """A body from 40 rows of one corner of an arm's range."""
    rng = np.random.default_rng(0)
    q = rng.uniform([0.0, 0.5], [0.6, 1.2], (40, 2))
    angle = np.cumsum(q, axis=1)
    x = np.stack([np.cos(angle) @ [0.3, 0.25], np.sin(angle) @ [0.3, 0.25]], axis=1)
    x += 2e-4 * rng.standard_normal(x.shape)
    return body_fit.fit(planar_structure(x, ("a", "b"), (True, True)), [Rows(q, x)]).body


def information(body, q):
    """Nats that rows (k, dof) tell, from the whole covariance of their positions."""
    _, x = body.structure.linearise(q, body.beta, body.active)
    flat = (x / np.hypot(body.noise, body.tau)[:, None]).reshape(2 * len(q), -1)
    total = np.eye(2 * len(q)) + body.kappa**2 * flat @ body.covariance @ flat.T
    return np.linalg.slogdet(total)[1]


CHOICE = np.random.default_rng(1).uniform([0.0, 0.3], [1.5, 2.6], (60, 2))


def test_each_pose_is_the_most_informative_beside_those_before(body):
    chosen = most_telling(body, CHOICE, 4)
    assert len(set(chosen.tolist())) == 4
    for k in range(4):
        gain = [information(body, CHOICE[[*chosen[:k], other]]) for other in range(60)]
        taken = chosen[:k]
        assert np.argmax(np.where(np.isin(np.arange(60), taken), -np.inf, gain)) == chosen[k]

"""A body in a model file: the round trip, hostile headers and arrays, scalar queries."""

import json

import numpy as np
import pytest

from calib.body import fitting
from calib.body.belief import Body
from calib.body.nominal import Nominal
from calib.body.planar import planar_structure
from calib.model_file.contents import FORMAT


def a_log(n=60):
    generator = np.random.default_rng(0)
    q = generator.uniform(-1.5, 1.5, (n, 2))
    bent = q + np.stack([2e-3 * np.sin(11 * q[:, 0]), 1e-3 * np.sin(9 * q[:, 1])], axis=1)
    phi = np.cumsum(bent, axis=1)
    p = (np.array([0.3, 0.25]) * np.exp(1j * phi)).sum(axis=1)
    return q, np.stack([p.real, p.imag], axis=1) + generator.normal(0, 1e-4, (n, 2))


@pytest.fixture(scope="module")
def body() -> Body:
    q, z = a_log(150)
    structure = planar_structure(z, ("a", "b"), (True, True), Nominal((0.3, 0.25), (0, 0)))
    fitted = fitting.fit(structure, q, z)
    assert fitted.body.second is not None
    return fitted.body


def stored(body: Body):
    told, arrays = FORMAT.write(body, Body)
    return json.loads(json.dumps(told)), arrays


def rebuilt(told, arrays) -> Body:
    return FORMAT.read(Body, told, arrays)


def test_round_trip_keeps_every_bit(body):
    header, arrays = stored(body)
    again = rebuilt(header, arrays)
    q = a_log()[0]
    assert np.array_equal(again.predict(q), body.predict(q))
    assert np.array_equal(again.bound(q), body.bound(q))
    assert stored(again)[0] == header
    assert all(np.array_equal(v, stored(again)[1][k]) for k, v in arrays.items())
    assert again.describe() == body.describe()


def test_a_two_joint_log_model_stays_small(body):
    assert sum(v.nbytes for v in stored(body)[1].values()) < 400_000

"""Derivatives of structures are differences; fits of bodies find exact worlds, and noise."""

from dataclasses import replace

import numpy as np
import pytest
from models import seen_by_two

import calib
from calib.body.body_fit import fit as fit_body
from calib.body.covariance import autocorrelation_time, radius_95
from calib.body.planar import planar_structure
from calib.body.rows import Rows
from calib.body.spatial import structure_of

STEP = 1e-6


def in_plane(revolute=(True, True), view="rigid", signs=(1, 1), mirror=1):
    names = tuple(f"j{k}" for k in range(len(revolute)))
    structure = planar_structure(np.eye(2), names, revolute, view=view)
    sensor = {"extent": 0.4, "mirror": mirror, "centre": (0.1, -0.2)}
    structure = replace(structure.with_sensor(**sensor), signs=signs)
    rng = np.random.default_rng(0)
    beta = structure.prior(structure.members()[-1][1]).mean + rng.normal(0, 0.02, structure.size)
    beta[structure.groups["length"]] = 0.3
    beta[structure.groups["view.shift"]] = 0.5, -0.3
    return structure, rng.uniform(-1, 1, (4, structure.dof)), beta


def in_space(robot, view, sensors=1):
    """An arm a little off everywhere, before a sensor that stands somewhere."""
    arm = calib.load_arm(robot)
    alone = sensors == 1
    structure = structure_of(arm, view) if alone else seen_by_two().by("right").body.structure
    rng, groups = np.random.default_rng(0), structure.groups
    beta = structure.neutral() + rng.normal(0, 1e-2, structure.size)
    beta[groups["lens"]] = (900.0, 640.0, 360.0, -0.1)
    if view == "pinhole":
        beta[groups["view.shift"]] = (0.1, 0.2, 3.0)
    else:
        beta[groups["view.rotation"]] = rng.normal(0, 1, 3)
    return structure, rng.uniform(arm.lower, arm.upper, (5, arm.dof)), beta


@pytest.mark.parametrize(
    ("world", "case"),
    [
        (in_plane, ((True, True), "rigid", (1, 1), 1)),
        (in_plane, ((True, True, True), "homography", (1, -1, 1), -1)),
        (in_plane, ((True, False, True), "affine", (1, 1, -1), 1)),
        (in_plane, ((False, True), "homography", (1, 1), -1)),
        *((in_space, ("spatial_three", view)) for view in ("base", "rigid", "similarity")),
        (in_space, ("spatial_three", "pinhole")),
        (in_space, ("spatial_three", "rigid", 2)),
        (in_space, ("six_axis", "pose")),
    ],
)
def test_derivatives_are_differences(world, case):
    structure, q, beta = world(*case)
    seen, by_beta = structure.linearise(q, beta)
    np.testing.assert_array_equal(seen, structure.predict(q, beta))

    def agrees(up, down, exact):
        difference = (structure.residual(up, seen) - structure.residual(down, seen)) / (2 * STEP)
        atol = 1e-6 * (1 + np.abs(exact).max())
        np.testing.assert_allclose(difference, exact, atol=atol, rtol=1e-6)

    # harmonics are many, and alike
    harmonics = [structure.groups[f"curve.{k}"][5:] for k in range(structure.dof)]
    for k in np.setdiff1d(np.arange(structure.size), np.concatenate(harmonics)):
        step = STEP * np.eye(structure.size)[k]
        up = structure.predict(q, structure.retract(beta, step))
        down = structure.predict(q, structure.retract(beta, -step))
        agrees(up, down, by_beta[:, :, k])
    by_joint = structure.slope(q, beta)
    for k, step in enumerate(STEP * np.eye(structure.dof)):
        up, down = structure.predict(q + step, beta), structure.predict(q - step, beta)
        agrees(up, down, by_joint[:, :, k])


LENGTHS = np.array([0.3, 0.25, 0.15])
TWO = (True, True)


def chain(q, lengths, offsets=0.0, signs=1.0):
    phi = np.cumsum(q * signs + offsets, axis=1)
    return (lengths * np.exp(1j * phi)).sum(axis=1)


def seen(p, rotation=0.4, shift=0.1 - 0.2j, mirror=False):
    w = np.exp(1j * rotation) * (p.conj() if mirror else p) + shift
    return np.stack([w.real, w.imag], axis=1)


def rows(n, dof, seed=0, reach=1.5):
    return np.random.default_rng(seed).uniform(-reach, reach, (n, dof))


def fit(q, z, revolute=(True, True), **options):
    names = "abc"[: len(revolute)]
    return fit_body(planar_structure(z, names, revolute, **options), [Rows(q, z)]).body


def curved(q):
    return seen(chain(q + 2e-3 * np.sin(q * [13, 17] + [0, 1]), LENGTHS[:2]))


def test_curves_pass_the_gate_where_there_are_curves_and_only_there():
    q = rows(300, 2, seed=10)
    noise = np.random.default_rng(11).normal(0, 1e-4, (300, 2))
    with_curves = fit(q, curved(q) + noise)
    without = fit(q, seen(chain(q, LENGTHS[:2])) + noise)
    assert "curves" in with_curves.member
    assert "curves" not in without.member
    ask = rows(300, 2, seed=12, reach=1.4)
    error = np.linalg.norm(with_curves.predict(ask) - curved(ask), axis=1)
    assert error.mean() < 2e-4
    assert np.mean(error <= with_curves.bound(ask, noise=False)) > 0.9
    line = next(line for line in with_curves.describe() if "joint curve" in line)
    curve = float(line.split("joint curve ")[1].split()[0])
    assert curve == pytest.approx(2 / np.sqrt(2), rel=0.5)


def test_a_further_covariance_adds_to_that_of_a_belief():
    q = rows(60, 2, seed=3)
    body = fit(q, seen(chain(q, LENGTHS[:2])))
    free = np.setdiff1d(np.arange(body.structure.size), body.active)
    indices = np.sort([body.active[0], free[0]])
    wider = body.with_covariance(indices, np.array([[2.0, 0.5], [0.5, 1.0]]))
    before = body.full_root @ body.full_root.T
    before[np.ix_(indices, indices)] += [[2.0, 0.5], [0.5, 1.0]]
    np.testing.assert_allclose(wider.full_root @ wider.full_root.T, before, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("lengths", [(0.6, 0.05), (300.0, 250.0), (3e-4, 2.5e-4)])
def test_a_wrong_geometry_does_no_harm(lengths):
    drawn = calib.load_arm("two_link")
    for name, length in zip(drawn.joint_names, lengths, strict=True):
        drawn = drawn.with_link_length(name, length)
    q = rows(100, 2, seed=22)
    z = seen(chain(q, LENGTHS[:2])) + np.random.default_rng(23).normal(0, 1e-4, (100, 2))
    model = calib.train(calib.Samples(q, z, drawn.joint_names, arm=drawn), size=4)
    assert model.about.errors["local"]["forward"]["distance"]["mean"] < 3e-4
    lengths = model.body.beta[model.body.structure.groups["length"]]
    assert np.allclose(lengths, LENGTHS[:2], atol=1e-3)


def lens_about(z):
    offset = z - [0.2, 0.25]
    return z + 0.8 * (offset**2).sum(axis=1, keepdims=True) * offset


def camera_on_metres(z):
    return z / (1 + z @ np.array([0.2, -0.1]))[:, None]


def giving_way(q):
    bend = 0.02 * np.cos(np.cumsum(q, axis=1))
    return q + np.stack([bend.sum(axis=1), bend[:, 1]], axis=1)


def with_slide(q):
    p = np.exp(1j * q[:, 0]) * (0.2 + q[:, 1] * np.exp(0.3j))
    return seen(p + 0.15 * np.exp(1j * (q[:, 0] + q[:, 2])))


def turning(dof, mirror):
    signs, offsets = np.array([1.0, -1.0, 1.0])[:dof], np.array([0.0, 0.5, -1.2])[:dof]
    return lambda q: seen(chain(q, LENGTHS[:dof], offsets, signs), mirror=mirror)


EXACT_WORLDS = {  # positions, which joints turn, the member that holds it, how near it comes
    "a lens": (lambda q: lens_about(seen(chain(q, LENGTHS[:2]))), TWO, "view", 1e-9),
    "a tilted sensor": (lambda q: camera_on_metres(seen(chain(q, LENGTHS[:2]))), TWO, "view", 1e-9),
    "flexion": (lambda q: seen(chain(giving_way(q), LENGTHS[:2])), TWO, "elastic", 1e-9),
    "a gear": (lambda q: seen(chain(q * [1.0, 1.03], LENGTHS[:2])), TWO, "chain", 1e-9),
    "a slide": (with_slide, (True, False, True), "", 1e-12),
    **{
        f"{dof} joints{', mirrored' * mirror}": (turning(dof, mirror), (True,) * dof, "", 1e-12)
        for dof in (1, 2, 3)
        for mirror in (False, True)
    },
}


@pytest.mark.parametrize("name", EXACT_WORLDS)
def test_exact_simulated_worlds_are_found_by_the_member_that_holds_them(name):
    world, revolute, member, most = EXACT_WORLDS[name]
    reach = 1.0 if member else 1.5
    q, ask = rows(300, len(revolute), 27, reach), rows(100, len(revolute), 28, reach)
    body = fit(q, world(q), revolute, simulated=True)
    assert np.abs(body.predict(ask) - world(ask)).max() < most
    assert body.member.endswith(member)
    assert member or (body.bound(ask, noise=False) < 1e-6).all()
    if not member and all(revolute):
        lengths = body.beta[body.structure.groups["length"]]
        assert np.allclose(lengths, LENGTHS[: len(revolute)], atol=1e-11)


@pytest.mark.parametrize("deviations", [(1.0, 1.0), (1.0, 0.3), (1.0, 0.0), (1.0, 0.5, 0.2)])
def test_95_percent_of_a_gaussian_lie_within_its_radius(deviations):
    points = np.random.default_rng(0).normal(0, deviations, (200_000, len(deviations)))
    (radius,) = radius_95(np.diag(np.square(deviations))[None])
    assert radius == pytest.approx(np.quantile(np.linalg.norm(points, axis=1), 0.95), rel=0.02)


@pytest.mark.parametrize("alike", [0.0, 0.5, 0.8])
def test_the_time_of_an_autoregression_is_that_of_the_textbook(alike):
    from scipy.signal import lfilter

    rng = np.random.default_rng(0)
    r = lfilter([1.0], [1.0, -alike], rng.normal(size=(20_000, 2)), axis=0)
    assert autocorrelation_time(r) == pytest.approx((1 + alike) / (1 - alike), rel=0.1)

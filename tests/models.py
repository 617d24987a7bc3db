"""Trained models and closed forms that several test files share; each is trained once."""

import pickle
import re
import shutil
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from chains import planar_chain
from conftest import lengths

import calib
from calib.arm.loading import arm_from_urdf
from calib.body.spatial import structure_of

L1, L2 = 0.30, 0.25
"""Link lengths of `two_link` and `two_link_full` [m]."""
ELBOW = np.radians([15.0, 150.0])
"""Limits of the elbow of `two_link`."""
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")


@cache
def trained(robot: str = "two_link", n: int = 3000, size: int = 20, noise: float = 0.0, **options):
    """Return a small model of a bundled robot."""
    samples = calib.babble(calib.load_arm(robot), n, seed=0, noise=noise)
    return calib.train(samples, size=size, **options)


@cache
def warm(model: calib.Model) -> calib.Model:
    """Return a copy of a model whose queries compiled C answers."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler here")
    fast = pickle.loads(pickle.dumps(model))
    said = fast.warm_up()
    assert fast.warm, said
    return fast


@cache
def papers(noise: float = 0.0):
    """Return the model of the paper's best table: two_link, 70x70, 20,000 samples, seed 0."""
    return calib.train(babbled(n=20_000, seed=0, noise=noise), size=70, seed=0)


@cache
def measured(n: int = 1200, size: int | None = 10, noise: float = 1e-3):
    """Return a model of a log: what is simulated is not known to the training."""
    return calib.train(log(n, noise), size=size)


@cache
def learned(robot: str = "two_link"):
    """Return a model of 400 rows of a robot that no simulation is known of."""
    return calib.train(bare(robot, 400, 7), size=6)


@cache
def turning():
    """Return a model of a log whose first joint turns round and round."""
    rng = np.random.default_rng(0)
    lower, upper = np.array([-np.pi, 0.3]), np.array([np.pi, 2.5])
    q = rng.uniform(lower, upper, (1500, 2))
    samples = calib.Samples(q, two_link(q), ("base", "elbow"), lower, upper, (True, True))
    return calib.train(samples, size=15)


@cache
def tilted_camera():
    """Return a planar arm before a tilted camera with a lens, whose pixels are not exact."""

    def seen(q):
        x = two_link(q)
        away = 900 * x / (1.2 + 0.2 * x[:, :1])
        return 640 + away + 1e-7 * away * (away**2).sum(axis=1, keepdims=True)

    return calib.train(sensed(arm(), 300, 0, seen, 1.0, unit="px"), size=6)


@cache
def wide():
    """Return `two_link` with a shoulder that turns from -6.2 to 6.2 rad."""
    limit = '<limit lower="0.0" upper="1.5707963267948966"'
    return arm_from_urdf(arm().urdf.replace(limit, '<limit lower="-6.2" upper="6.2"'))


def log_of(arm, q: np.ndarray, x: np.ndarray, **facts) -> calib.Samples:
    """Return rows of an arm as a sensor measured them."""
    limits = arm.lower, arm.upper, arm.revolute
    return calib.Samples(q, x, arm.joint_names, *limits, arm=arm, **facts)


def sensed(arm, n: int, seed: int, truth=None, noise: float = 1e-4, **facts) -> calib.Samples:
    """Return rows at random joints of an arm whose tip is at truth(q), with a sensor's noise."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (n, arm.dof))
    x = (truth or arm.forward)(q)
    return log_of(arm, q, x + rng.normal(0.0, noise, x.shape), **facts)


def seen_through(log: calib.Samples, lens) -> calib.Samples:
    """Return a log of pixels of a camera, of 1280x720 px, whose lens is known."""
    known = replace(log.camera, size=(1280, 720), lens=lens, lens_sd=(0.0,) * 4, note="")
    return replace(log, camera=known)


def log(n: int, noise: float = 0.0, seed: int = 0) -> calib.Samples:
    """Return a log of two_link, without what only a simulation knows."""
    s = babbled(n=n, seed=seed, noise=noise)
    return log_of(arm(), s.q, s.x)


def bare(robot, n: int, seed: int, *changes: str, noise: float = 2e-4) -> calib.Samples:
    """Return rows of a robot, or of an arm by its name, that no simulation is known of."""
    arm = calib.load_arm(robot) if isinstance(robot, str) else robot
    return replace(calib.babble(arm, n, seed=seed, noise=noise, changes=changes), simulation=None)


def of_a_third(n: int, waves: float, seed: int = 0):
    """Return rows of six joints within a third of their ranges, without a drawing; truth, others.

    Joints err by waves [rad]; the noise is 20 um; others are 400 joint values within that third.
    """
    arm = calib.load_arm("six_axis")
    limits = zip(arm.joint_names, arm.lower.tolist(), arm.upper.tolist(), strict=True)
    third = {name: (0.65 * a + 0.35 * b, 0.35 * a + 0.65 * b) for name, a, b in limits}

    def exact(q):
        return arm.forward(q + waves * np.sin(9 * q + np.arange(6)))

    rows = calib.babble(arm.with_range(third), n, seed=seed, noise=2e-5)
    x = rows.x + exact(rows.q) - arm.forward(rows.q)
    rows = replace(rows, x=x, simulation=None, arm=None, lower=arm.lower, upper=arm.upper)
    return rows, exact, calib.babble(arm.with_range(third), 400, seed=9).q


def without_masses(arm):
    """Return an arm of whose links no masses are stated."""
    return arm_from_urdf(re.sub(r"<inertial>.*?</inertial>", "", arm.urdf, flags=re.DOTALL))


@cache
def arm() -> calib.PlanarArm:
    return calib.load_arm("two_link")


def babbled(*changes: str, n: int = 200, noise: float = 1e-3, seed: int = 1) -> calib.Samples:
    """Babbling of `two_link` after changes such as `elbow.length=+20%`."""
    return calib.babble(arm(), n, seed=seed, noise=noise, changes=list(changes))


def model(noise: float = 0.0) -> calib.Model:
    """Return a model of `two_link` by many rows."""
    return trained(n=4000, size=30, noise=noise)


def distances(model: calib.Model, q: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return how far (n,) [m] a model's answers are from the truth, NaN where there is none."""
    return lengths(model.forward(q) - truth)


def accuracy(model: calib.Model, q: np.ndarray, truth: np.ndarray, bound: str = "model_error"):
    """Return the mean distance [m] of answers from the truth, and the share within a bound."""
    off = distances(model, q, truth)
    return off.mean(), np.mean(off <= getattr(model, bound)(q))


def error(adapted: calib.Model, samples: calib.Samples) -> float:
    """Return the mean distance [m] to the true position all over the workspace."""
    q = draw(adapted, 1000, seed=7)
    return float(distances(adapted, q, samples.simulation.exact(q)).mean())


def no_arm(n: int) -> calib.Samples:
    """Return a log of a smooth map that no chain of links explains."""
    rows = log(n)
    a, b = ((rows.q - rows.lower) / (rows.upper - rows.lower)).T
    x = np.stack([a * np.exp(b), b**2 - a**3], axis=1)
    return replace(rows, x=x, arm=None)


def two_link(q: np.ndarray, l1: float = L1, l2: float = L2, tip=(0.0, 0.0)) -> np.ndarray:
    """Tip of the 2R arm by the textbook, moved in the last link's frame: (..., 2) -> (..., 2)."""
    a, b = q[..., 0], q[..., 0] + q[..., 1]
    x = l1 * np.cos(a) + (l2 + tip[0]) * np.cos(b) - tip[1] * np.sin(b)
    y = l1 * np.sin(a) + (l2 + tip[0]) * np.sin(b) + tip[1] * np.cos(b)
    return np.stack([x, y], axis=-1)


def two_link_inverse(x: np.ndarray, sign: float) -> np.ndarray:
    """Joints of the 2R arm by the textbook, elbow of the sign given: (n, 2) -> (n, 2)."""
    square = (x**2).sum(axis=1)
    elbow = sign * np.arccos((square - L1**2 - L2**2) / (2 * L1 * L2))
    ahead = np.arctan2(L2 * np.sin(elbow), L1 + L2 * np.cos(elbow))
    return np.stack([np.arctan2(x[:, 1], x[:, 0]) - ahead, elbow], axis=1)


def bytes_of(model: calib.Model) -> bytes:
    """Return the content of a model's file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "m.calib"
        model.save(path)
        return path.read_bytes()


def draw(model: calib.Model, n: int, seed: int = 0, margin: float = 0.0) -> np.ndarray:
    """Draw joints from a model's range, a share of it apart from the limits: (n, dof)."""
    u = np.random.default_rng(seed).uniform(margin, 1 - margin, (n, len(model.about.lower)))
    return model.about.lower + u * (model.about.upper - model.about.lower)


def built(*, curves: bool = False):
    """Return `spatial_three`, its structure, parameters as if built, and what drew them."""
    arm = calib.load_arm("spatial_three")
    structure = structure_of(arm, "rigid")
    rng, groups = np.random.default_rng(0), structure.groups
    beta = structure.neutral()
    beta[groups["view.rotation"]] = rng.normal(0, 1, 3)
    beta[groups["view.shift"]] = rng.normal(0, 1, 3)
    beta[groups["tool"]] = rng.normal(0, 0.02, 3)
    beta[structure.shifts] = rng.normal(0, 5e-4, (3, 3))
    beta[structure.turns] = rng.normal(0, 1e-3, (3, 3))
    beta[groups["elastic"]] = -1e-3
    for k in range(3 * curves):
        beta[groups[f"curve.{k}"][[9, 48 + 14]]] = rng.normal(0, 5e-4, 2)
    return arm, structure, beta, rng


def seen_from(sensor: str, rows: int, seed: int, shift: float):
    """Return what a tracker that stands at `shift` [m] reads of the arm, and its truth for it."""
    arm, structure, beta, _ = built()
    beta[structure.groups["view.shift"]] += shift
    truth = partial(structure.predict, beta=beta)
    return sensed(arm, rows, seed, truth, sensor=sensor), truth


@cache
def seen_by_two() -> calib.Model:
    """Return a model of two trackers whose frames are half a metre apart."""
    logs = [seen_from("left", 40, 1, 0.0)[0], seen_from("right", 60, 2, 0.5)[0]]
    return calib.train(logs, size=3)


@cache
def in_space(n: int = 240):
    """Return a model of a log of `spatial_three` as it was built, with joint curves."""
    arm, structure, beta, rng = built(curves=True)
    q = rng.uniform(arm.lower, arm.upper, (n, 3))
    x = structure.predict(q, beta) + rng.normal(0, 2e-5, (n, 3))
    return calib.train(log_of(arm, q, x, unit="m"), size=5)


@cache
def in_pixels(n: int = 60, robot: str = "spatial_three"):
    """Return a model of an arm that a camera of a known lens sees from the side."""
    arm = calib.load_arm(robot)
    lens = (900.0, 640.0, 360.0, -0.1)
    structure = structure_of(arm, "pinhole", unit="px", lens=lens, lens_sd=(0.0,) * 4)
    beta, groups = structure.neutral(), structure.groups
    beta[groups["view.rotation"]] = (-1.3, 0.2, 0.1)
    beta[groups["view.shift"]] = (0.05, 0.1, 2.0)
    beta[groups["offset"][1:3]] = (0.03, -0.02)
    log = sensed(arm, n, 0, lambda q: structure.predict(q, beta), 0.3, unit="px")
    return calib.train(seen_through(log, lens), size=5)


@cache
def six():
    """Return a six-joint arm in space, every parameter of which is off."""
    arm = calib.load_arm("six_axis")
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (30, 6))
    drawn = calib.train(log_of(arm, q, arm.forward(q)), size=3)
    structure = drawn.body.structure
    rng, beta = np.random.default_rng(1), drawn.body.beta.copy()
    groups = ("tool.rotation", "placement", "offset", "elastic", "payload", "gravity", "coupling")
    for group in (*groups, "curve.1", "curve.4"):
        beta[structure.groups[group]] += rng.normal(0, 1e-3, len(structure.groups[group]))
    # uncertain too, in another posture of gravity
    active = np.concatenate([structure.groups[group] for group in groups])
    root = rng.normal(0, 1e-5, (len(active), 9))
    return replace(drawn, body=replace(drawn.body, beta=beta, active=active, root=root))


def of_the_drawing(body) -> np.ndarray:
    """Parameters (d,) of the drawing's arm with the tool that a body in space knows."""
    structure = body.structure
    beta = structure.neutral()
    shared = [ix for name, ix in structure.groups.items() if name.startswith(("view.", "tool"))]
    beta[np.concatenate(shared)] = body.beta[np.concatenate(shared)]
    return beta


@cache
def in_plane():
    """Return a planar arm of four joints, one a slide, behind a bent lens; all is uncertain."""
    arm = arm_from_urdf(planar_chain(4, slide=2), [f"j{k + 1}" for k in range(4)])
    drawn = calib.train(calib.babble(arm, 60, seed=0), size=3)
    structure = drawn.body.structure.with_sensor(view="homography")
    rng, beta = np.random.default_rng(1), drawn.body.beta.copy()
    geometry = np.concatenate([ix for name, ix in structure.groups.items() if "curve" not in name])
    beta[geometry] += rng.normal(0, 0.02, len(geometry))
    curves = np.arange(len(geometry), structure.size)
    beta[curves] = rng.normal(0, 1e-4, len(curves))
    root = 1e-4 * rng.normal(size=(structure.size, 40))  # which couples curves with all
    uncertain = {"active": np.arange(structure.size), "root": root, "second": None}
    body = replace(drawn.body, structure=structure, beta=beta, **uncertain)
    bounds = np.zeros(drawn.motor.size)
    return replace(drawn, body=body, bounds=bounds, model_bounds=bounds)

"""Closed forms of planar arms with two and three links, and URDFs of chains."""

import numpy as np

from calib import PlanarArm


def chain_urdf(joints: int, reach: float = 0.6, half: float = 1.4, slide: int | None = None) -> str:
    """Return the URDF of a planar chain of equal links; one joint may slide."""
    length = reach / joints
    parts = [f'<robot name="planar_{joints}r"><link name="base"/>']
    for k in range(joints):
        kind, axis, lower, upper = "revolute", "0 0 1", -half, half
        if k == slide:
            kind, axis, lower, upper = "prismatic", "1 0 0", 0.0, 0.1
        parent, x = (f"link_{k}", length) if k else ("base", 0.0)
        parts.append(
            f'<link name="link_{k + 1}"/><joint name="joint_{k + 1}" type="{kind}">'
            f'<parent link="{parent}"/><child link="link_{k + 1}"/><origin xyz="{x} 0 0"/>'
            f'<axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
        )
    parts.append(
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="link_{joints}"/>'
        f'<child link="tip"/><origin xyz="{length} 0 0"/></joint></robot>'
    )
    return "".join(parts)


def branches_2r(arm: PlanarArm, x: np.ndarray) -> list[np.ndarray]:
    """Every solution inside the limits, by the law of cosines: a (k, 2) array per target.

    The geometry c + R(s q1) a + R(s q1 + t q2) b is fitted to the arm's own positions.
    """
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (200, 2))
    seen = arm.forward(q) @ (1, 1j)
    for s, t in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        columns = [np.ones(200), np.exp(1j * s * q[:, 0]), np.exp(1j * (s * q[:, 0] + t * q[:, 1]))]
        fit = np.linalg.lstsq(np.stack(columns, axis=1), seen, rcond=None)[0]
        if np.abs(np.stack(columns, axis=1) @ fit - seen).max() < 1e-9:
            break
    else:
        raise AssertionError("not an arm of two turning joints")
    c, a, b = fit
    z = x @ (1, 1j) - c
    cosine = (np.abs(z) ** 2 - abs(a) ** 2 - abs(b) ** 2) / (2 * abs(a) * abs(b))
    found: list[list[np.ndarray]] = [[] for _ in x]
    for sign in (1, -1):
        bend = sign * np.arccos(np.clip(cosine, -1, 1)) + np.angle(a) - np.angle(b)
        turn = np.angle(z) - np.angle(a + np.exp(1j * bend) * b)
        q = np.stack([s * turn, t * bend], axis=1)
        q = arm.lower + (q - arm.lower + 1e-9) % (2 * np.pi) - 1e-9
        inside = (np.abs(cosine) <= 1) & (q <= arm.upper + 1e-9).all(axis=1)
        for i in np.flatnonzero(inside):
            if not found[i] or np.abs(found[i][0] - q[i]).max() > 1e-6:
                found[i].append(q[i])
    return [np.array(f).reshape(-1, 2) for f in found]


def families_3r(links: tuple[float, float, float], lower: np.ndarray, upper: np.ndarray, x):
    """Every connected curve of solutions inside the limits: a list of (k, 3) arrays.

    The direction of the last link is swept; the first two follow by the law of cosines.
    """
    a, b, c = links
    phi = np.linspace(lower.sum(), upper.sum(), 30_001)
    wrist = x - c * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    cosine = ((wrist**2).sum(axis=1) - a**2 - b**2) / (2 * a * b)
    curves = []
    for sign in (1, -1):
        elbow = sign * np.arccos(np.clip(cosine, -1, 1))
        ahead = np.arctan2(b * np.sin(elbow), a + b * np.cos(elbow))
        shoulder = np.arctan2(wrist[:, 1], wrist[:, 0]) - ahead
        shoulder = (shoulder + np.pi) % (2 * np.pi) - np.pi
        q = np.stack([shoulder, elbow, phi - shoulder - elbow], axis=1)
        inside = (np.abs(cosine) <= 1) & ((q >= lower) & (q <= upper)).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
        curves += [q[i:j] for i, j in zip(edges[::2], edges[1::2], strict=True)]
    return curves

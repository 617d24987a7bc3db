"""The bundled six-axis arm's inverse in closed form: up to eight branches of a UR-like arm."""

import numpy as np

from calib.arm.rotations import exponential

HEIGHT, SIDE, UPPER, FORE, DROP, TOOL = 0.16, 0.20, 0.42, 0.38, 0.09, 0.08


def closed_form(position: np.ndarray, frame: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Every joint vector (b, 6) that reaches a pose, by geometry; `tip` is the tip's frame at zero.

    The orientation is Rz(q1) Ry(q2 + q3 + q4) Rz(-q5) Ry(q6) `tip`, and the wrist lies 0.20 m
    beside the vertical plane of the two links.
    """
    r = frame @ tip.T
    wrist = position - TOOL * r[:, 1]
    out = []
    far = np.hypot(wrist[0], wrist[1])
    if far < SIDE:
        return np.empty((0, 6))
    for side in (np.arcsin(SIDE / far), np.pi - np.arcsin(SIDE / far)):
        q1 = np.arctan2(wrist[1], wrist[0]) - side
        back = exponential(np.array([0.0, 0.0, -q1]))
        m, w = back @ r, back @ wrist
        for sign in (1, -1):
            q5 = sign * np.arccos(np.clip(m[1, 1], -1, 1))
            s5 = np.sin(q5)
            if abs(s5) < 1e-9:
                continue
            total = np.arctan2(-m[2, 1] / s5, m[0, 1] / s5)
            q6 = np.arctan2(-m[1, 2] / s5, -m[1, 0] / s5)
            x = w[0] + DROP * np.sin(total)
            z = -(w[2] - HEIGHT + DROP * np.cos(total))
            bend = (x * x + z * z - UPPER**2 - FORE**2) / (2 * UPPER * FORE)
            if abs(bend) > 1:
                continue
            for q3 in (np.arccos(bend), -np.arccos(bend)):
                q2 = np.arctan2(z, x) - np.arctan2(FORE * np.sin(q3), UPPER + FORE * np.cos(q3))
                out.append([q1, q2, q3, total - q2 - q3, q5, q6])
    return np.array(out).reshape(-1, 6)

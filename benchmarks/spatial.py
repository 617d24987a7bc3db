"""Arms in space: held-out errors and coverage, new mountings, other tools, a camera.

    python benchmarks/spatial.py --data FOLDER [--part PART] [--series a,c] [--rows 0,300,100,30]
        [--draws 5] [--peer NAME=PYTHON]

Prints the tables of docs/accuracy.md. FOLDER holds full_a.csv and full_c.csv: six joints of a UR10
and what a laser tracker saw (Landgraf et al., CASE 2021; their README names the source). Rows are
held out in ten contiguous blocks, of which `--draws` are taken in turn; 0 rows are all others. The
UR10's URDF is example-robot-data's. Other tools have environments of their own:

    python -m venv one; one/bin/pip install "numpy<2" robotkinecal==0.1.0
    python -m venv two; two/bin/pip install figaroh==1.0.2
    ... --part peer --peer robotkinecal=one/bin/python --peer figaroh=two/bin/python
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from tables import table
from threadpoolctl import threadpool_limits

import calib

HERE = Path(__file__).parent
ROBOTS = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
UR10 = ROBOTS / "ur_description/urdf/ur10_robot.urdf"
SO101 = ROBOTS / "so_arm_description/urdf/so101.urdf"
MM = 1e3
PEER_ROWS = 1000  # evenly spaced, that other tools and calib learn from: geometry needs no more

Row = dict[str, Any]


def series(args: argparse.Namespace, name: str) -> calib.Samples:
    """Joints [rad] and positions [m] of a series, without orientations."""
    log = calib.read_log(args.data / f"full_{name}.csv", calib.load_arm(UR10, tip="tool0"))
    return replace(log, orientation=None)


def split(n: int, rows: int, draws: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows to learn from, and the contiguous block that is held out."""
    blocks = np.array_split(np.arange(n), 10)
    for draw in range(draws):
        held = blocks[2 * draw % 10]
        pool = np.setdiff1d(np.arange(n), held)
        if rows:
            pool = np.sort(np.random.default_rng(draw).choice(pool, rows, replace=False))
        yield pool, held


def judged(model: calib.Model, log: calib.Samples) -> np.ndarray:
    """Distance and bound (2, n) of rows that are held out, NaN where no answer is given."""
    gap = np.linalg.norm(model.forward(log.q) - log.x, axis=1)
    return np.stack([gap, model.expected_error(log.q)])


def summary(judgements: list[np.ndarray]) -> Row:
    """Errors [mm], and the share of them that the bound covers."""
    error, bound = np.concatenate(judgements, axis=1)
    known = np.isfinite(error)
    return {
        "mean": MM * float(error[known].mean()),
        "95 %": MM * float(np.percentile(error[known], 95)),
        "max": MM * float(error[known].max()),
        "bound": MM * float(bound[known].mean()),
        "covered [%]": f"{100 * float((error <= bound)[known].mean()):.1f}",
        "answered [%]": f"{100 * float(known.mean()):.1f}",
    }


class Nominal:
    """The arm of the URDF; where the sensor stands and the probe sits fits rows best."""

    def __init__(self, arm: Any, log: calib.Samples) -> None:
        self.arm = arm
        place, turn = self._poses(log.q)
        # the frame for a probe at the flange, from which the search starts
        a, b = place - place.mean(axis=0), log.x - log.x.mean(axis=0)
        start = Rotation.align_vectors(b, a)[0]
        first = [*start.as_rotvec(), *(log.x - start.apply(place)).mean(axis=0), 0.0, 0.0, 0.0]
        fit = least_squares(lambda p: (self._seen(p, place, turn) - log.x).ravel(), first,
                            loss="soft_l1", f_scale=1e-3)  # fmt: skip
        self.found = fit.x

    def _poses(self, q: np.ndarray) -> tuple[np.ndarray, Rotation]:
        place, quaternion = self.arm.pose(q)
        return place, Rotation.from_quat(quaternion)

    @staticmethod
    def _seen(p: np.ndarray, place: np.ndarray, turn: Rotation) -> np.ndarray:
        return Rotation.from_rotvec(p[:3]).apply(place + turn.apply(p[6:9])) + p[3:6]

    def forward(self, q: np.ndarray) -> np.ndarray:
        """Positions (n, 3) [m] in the sensor's frame."""
        return self._seen(self.found, *self._poses(q))

    def screws(self) -> dict[str, Any]:
        """Axes, points and the tip's pose at zero in the sensor's frame, and the root's pose."""
        model = pinocchio.buildModelFromXML(self.arm.urdf)
        data, frame = model.createData(), model.getFrameId(self.arm.tip)
        zero = pinocchio.neutral(model)
        jacobian = pinocchio.computeJointJacobians(model, data, zero)
        pinocchio.updateFramePlacements(model, data)
        turn, shift = Rotation.from_rotvec(self.found[:3]), self.found[3:6]
        joints = [model.getJointId(name) for name in self.arm.joint_names]
        columns = [model.joints[k].idx_v for k in joints]
        tip = np.eye(4)
        tip[:3, :3] = turn.as_matrix() @ data.oMf[frame].rotation
        tip[:3, 3] = self.forward(np.zeros((1, len(joints))))[0]
        return {
            "urdf": self.arm.urdf,
            "tip": self.arm.tip,
            "axes": turn.apply(jacobian[3:, columns].T),
            "points": turn.apply([data.oMi[k].translation for k in joints]) + shift,
            "zero": tip,
            "base": np.concatenate([shift, turn.as_euler("xyz")]),
        }


def measure_rows(args: argparse.Namespace) -> Iterator[Row]:
    """Held-out errors [mm] by number of rows, beside the nominal arm in its best frame."""
    for name in args.series:
        log = series(args, name)
        for rows in args.rows:
            found, nominal = [], []
            for learn, held in split(len(log), rows, args.draws):
                found.append(judged(calib.train(log.take(learn)), log.take(held)))
                other = Nominal(log.arm, log.take(learn[:: max(1, len(learn) // 1000)]))
                nominal.append(np.linalg.norm(other.forward(log.q[held]) - log.x[held], axis=1))
            yield {"series": name.upper(), "rows": rows or "all",
                   "nominal": MM * float(np.concatenate(nominal).mean()),
                   **summary(found)}  # fmt: skip


def measure_peer(args: argparse.Namespace) -> Iterator[Row]:
    """Held-out errors [mm] beside those of other tools, all from the same rows."""
    for name in args.series if args.peer else ():
        log = series(args, name)
        errors: dict[str, list[np.ndarray]] = {}
        for learn, held in split(len(log), 0, args.draws):
            some = log.take(learn[:: -(-len(learn) // PEER_ROWS)])
            said = {"calib": calib.train(some).forward(log.q[held])}
            known = Nominal(log.arm, some).screws()
            for tool, python in args.peer:
                said[tool] = _said(tool, python, some, log.q[held], known)
            for tool, x in said.items():
                errors.setdefault(tool, []).append(np.linalg.norm(x - log.x[held], axis=1))
        means = {tool: MM * float(np.concatenate(e).mean()) for tool, e in errors.items()}
        yield {"series": name.upper(), "rows": len(some), **means}


def _said(tool: str, python: str, log: calib.Samples, asked: np.ndarray, known: Row) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder) / "given.npz", Path(folder) / "answer.npz"
        np.savez(given, q=log.q, z=log.x, asked=asked, **known)
        subprocess.run([python, HERE / f"peer_{tool}.py", given, answer], check=True)
        return np.asarray(np.load(answer)["found"])


def measure_mount(args: argparse.Namespace) -> Iterator[Row]:
    """`calib.adapt` of a model of one series to a few rows of the other, mounted anew [mm]."""
    for old, new in (("a", "c"), ("c", "a")):
        log, before = series(args, new), series(args, old)
        model = calib.train(before.take(np.arange(0, len(before), max(1, len(before) // 3000))))
        for rows in (10, 30, 100):
            found = []
            for draw in range(args.draws):
                chosen = np.random.default_rng(draw).choice(len(log), rows, replace=False)
                rest = np.setdiff1d(np.arange(len(log)), chosen)[::5]
                found.append(judged(calib.adapt(model, log.take(chosen)).model, log.take(rest)))
            yield {"from, to": f"{old}, {new}".upper(), "rows": rows, **summary(found)}


def measure_unknown(args: argparse.Namespace) -> Iterator[Row]:
    """Without a URDF: a chain from random starts [mm]."""
    for name in args.series:
        log = replace(series(args, name), arm=None)
        for rows in (30, 100):
            found = [judged(calib.train(log.take(learn)), log.take(held))
                     for learn, held in split(len(log), rows, args.draws)]  # fmt: skip
            yield {"series": name.upper(), "rows": rows, **summary(found)}


def measure_urdf(args: argparse.Namespace) -> Iterator[Row]:
    """The URDF that `calib urdf` writes beside the nominal one, frames of both fitted [mm]."""
    for name in args.series:
        log = series(args, name)
        ((learn, held),) = split(len(log), 1000, 1)
        with tempfile.TemporaryDirectory() as folder:
            model, new = Path(folder) / "m.calib", Path(folder) / "new.urdf"
            calib.train(log.take(learn)).save(model)
            subprocess.run([sys.executable, "-m", "calib_cli", "urdf", model, "-o", new],
                           check=True, capture_output=True)  # fmt: skip
            arms = {"nominal URDF": log.arm, "written URDF": calib.load_arm(new, tip="tool0")}
        gaps = {kind: Nominal(arm, log.take(learn)).forward(log.q[held]) - log.x[held]
                for kind, arm in arms.items()}  # fmt: skip
        means = {kind: MM * float(np.linalg.norm(gap, axis=1).mean()) for kind, gap in gaps.items()}
        yield {"series": name.upper(), **means}


def measure_camera(args: argparse.Namespace) -> Iterator[Row]:
    """A simulated SO-101 in 60 pictures of an unknown camera at 0.3 px, offsets up to 5 deg."""
    arm = calib.load_arm(SO101)
    for seed in range(args.draws):
        rng = np.random.default_rng(seed)
        offset = np.deg2rad(np.r_[0.0, rng.uniform(-5, 5, arm.dof - 1)])
        eye = np.array([0.15, -0.75, 0.35]) + rng.normal(0, 0.05, 3)
        ahead = np.array([0.15, 0, 0.12]) - eye
        z = ahead / np.linalg.norm(ahead)
        x = np.cross(z, (0.0, 0.0, 1.0)) / np.linalg.norm(np.cross(z, (0.0, 0.0, 1.0)))
        turn, focal, k1 = np.stack([x, np.cross(z, x), z]), 900 * rng.uniform(0.9, 1.1), -0.1

        def seen(q: np.ndarray, turn=turn, eye=eye, focal=focal, k1=k1, offset=offset):
            """Pixels, and which of them a camera of 1280x720 sees."""
            tip = (arm.forward(q + offset) - eye) @ turn.T
            flat = tip[:, :2] / tip[:, 2:]
            pixels = (640, 360) + focal * flat * (1 + k1 * (flat**2).sum(1, keepdims=True))
            inside = ((pixels > 20) & (pixels < (1260, 700))).all(axis=1) & (tip[:, 2] > 0.2)
            return pixels, inside & (arm.forward(q + offset)[:, 2] > 0.02)

        q = rng.uniform(arm.lower, arm.upper, (50_000, arm.dof))
        q = q[seen(q)[1]][:1060]
        pixels = seen(q)[0] + rng.normal(0, 0.3, (len(q), 2))
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log.csv"
            np.savetxt(log, np.hstack([q, pixels])[:60], delimiter=",", comments="",
                       header=",".join([*arm.joint_names, "x", "y"]))  # fmt: skip
            log = calib.read_log(log, arm, unit="px")
        model, fresh = calib.train(log), q[60:]
        fresh = fresh[np.isfinite(model.forward(fresh)).all(axis=1)]
        miss = np.linalg.norm(model.forward(fresh) - seen(fresh)[0], axis=1)
        said, true = _in_base(model, fresh), arm.forward(fresh + offset)
        a, b = said - said.mean(axis=0), true - true.mean(axis=0)
        u, s, vt = np.linalg.svd(b.T @ a)
        up_to = np.linalg.norm(b - s.sum() / (a**2).sum() * a @ (u @ vt).T, axis=1)
        bound = model.model_error(fresh)
        yield {"seed": seed, "error [px]": float(miss.mean()),
               "covered [%]": f"{100 * float((miss <= bound).mean()):.1f}",
               "tip [mm]": MM * float(np.linalg.norm(said - true, axis=1).mean()),
               "tip up to a similarity [mm]": MM * float(up_to.mean()),
               "answered of 1,000": len(fresh)}  # fmt: skip


def _in_base(model: calib.Model, q: np.ndarray) -> np.ndarray:
    """Positions (n, 3) [m] in the robot's root frame, as `calib query forward --in base` says."""
    with tempfile.TemporaryDirectory() as folder:
        rows, out = Path(folder) / "q.csv", Path(folder) / "x.csv"
        model.save(Path(folder) / "m.calib")
        np.savetxt(rows, q, delimiter=",", header=",".join(model.about.joint_names), comments="")
        command = ["query", "forward", Path(folder) / "m.calib", "--input", rows, "--output", out]
        command += ["--in", "base"]
        subprocess.run([sys.executable, "-m", "calib_cli", *command], check=True)
        found = np.genfromtxt(out, delimiter=",", names=True)
        return np.stack([found[name] for name in "xyz"], axis=1)


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "rows": measure_rows,
    "peer": measure_peer,
    "mount": measure_mount,
    "urdf": measure_urdf,
    "unknown": measure_unknown,
    "camera": measure_camera,
}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--series", type=lambda text: text.split(","), default=["a", "c"])
    parser.add_argument("--rows", type=lambda text: [int(n) for n in text.split(",")],
                        default=[0, 300, 100, 30])  # fmt: skip
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--peer", type=lambda text: text.split("=", 1), action="append")
    args = parser.parse_args()
    with threadpool_limits(1):
        for part in args.part or PARTS:
            table(str(PARTS[part].__doc__), PARTS[part](args))


if __name__ == "__main__":
    main()

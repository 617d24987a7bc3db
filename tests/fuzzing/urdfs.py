"""URDFs: random arms, which have to be right, and damaged ones, which may be refused."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from calib.arm.arm import Arm
from calib.arm.loading import PlanarArm, SpatialArm, arm_from_urdf, load_arm
from calib.arm.robots import resolve_robot
from calib.arm.urdf import parse_urdf
from calib.errors import CalibError
from calib.show.preview.arm import shapes
from calib.show.preview.mesh import resolve_mesh

from .arms import RandomArm, random_arm
from .guard import Trap, guarded, one_line
from .kinds import Kind
from .mutate import damaged
from .urdf_edits import EDITS, hostile

FAR = 1e4
"""Placements beyond this [m] are compared in parts of their size."""


class Truth:
    """Pinocchio's own reading of a URDF: framesForwardKinematics of the whole robot."""

    def __init__(self, text: str) -> None:
        import pinocchio

        self._pin: Any = pinocchio
        self._model = pinocchio.buildModelFromXML(text)
        self._data = self._model.createData()

    def tips(self, link: str, values: list[dict[str, float]]) -> np.ndarray:
        """Positions of a link, (n, 3) [m], for joint values by name [rad or m]."""
        pin, model = self._pin, self._model
        frame = model.getFrameId(link, pin.FrameType.BODY)
        found = []
        for row in values:
            q = pin.neutral(model)
            for number, name in enumerate(model.names):
                if number and name in row:
                    joint = model.joints[number]
                    turn = (np.cos(row[name]), np.sin(row[name]))
                    q[joint.idx_q : joint.idx_q + joint.nq] = turn if joint.nq == 2 else row[name]
            pin.framesForwardKinematics(model, self._data, q)
            found.append(self._data.oMf[frame].translation.copy())
        return np.array(found)


Mimics = dict[str, tuple[str, float, float]]


def compare(arm: Arm, text: str, mimics: Mimics) -> None:
    """Compare an arm with Pinocchio at random joint values."""
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (5, arm.dof))
    rows = []
    for row in q:
        values = {**arm.locked, **dict(zip(arm.joint_names, row, strict=True))}
        rows.append({**values, **{name: _followed(name, values, mimics) for name in mimics}})
    truth = Truth(text).tips(arm.tip, rows)
    # an axis may be askew by 1e-4 rad: what leaves the plane is projected onto it
    seen = arm.plane.project(truth) if isinstance(arm, PlanarArm) else truth
    size = max(1.0, np.abs(truth).max() / FAR, np.abs(arm.chain.points).max() / FAR)
    error = np.abs(arm.forward(q) - seen).max()
    assert error <= 1e-9 * size, f"the tip is off by {error:g} m"
    if not isinstance(arm, PlanarArm):
        return
    away = np.abs(arm.plane.distances(truth)).max()
    reach = np.abs(truth - arm.plane.origin).max() + np.abs(arm.chain.points).max()
    assert away <= 1e-9 * size + 1e-3 * reach, f"the tip leaves the plane by {away:g} m"


def _followed(name: str, values: dict[str, float], mimics: Mimics) -> float:
    """Value of a mimic joint, which may follow another mimic joint."""
    scale, shift = 1.0, 0.0
    for _ in mimics:
        if name in values or name not in mimics:
            break
        name, multiplier, offset = mimics[name]
        shift += scale * offset
        scale *= multiplier
    return scale * values.get(name, 0.0) + shift


class Arms(Kind):
    """Random arms: loaded and right, or refused for the reason that is known."""

    def make(self, rng: Random) -> RandomArm:
        """Make a robot with an arm in it."""
        return random_arm(rng)

    def judge(self, case: RandomArm) -> str:
        """Load it by its joints and without them, and compare it with Pinocchio.

        An arm with one joint out of the plane is spatial, and refused where a planar one is
        asked for.
        """
        with guarded(self.folder):
            flat = self._by_joints(case, case.refused, planar=True)
            bent = case.refused == "not planar"
            arm = self._by_joints(case, None if bent else case.refused)
            found = [self._automatic(case), self._automatic(case, planar=True)]
        for one in (flat, arm, *found):
            if one is not None:
                compare(one, case.text, case.mimics)
        assert isinstance(found[1], PlanarArm | None)
        if arm is None:
            return f"refused: {case.refused}"
        assert arm.joint_names == tuple(case.joints)
        if bent:
            assert isinstance(arm, SpatialArm)
        else:
            assert isinstance(arm, PlanarArm)
            assert np.linalg.norm(np.cross(arm.plane.normal, case.normal)) < 1e-6
        for name, value in arm.locked.items():
            assert abs(value - case.values[name]) < 1e-12
        return f"{arm.dof} joints, {'refused as planar, ' if bent else ''}right"

    def _by_joints(
        self, case: RandomArm, refused: str | None, *, planar: bool = False
    ) -> PlanarArm | SpatialArm | None:
        """Load the arm by its joints and tip; None where it was refused as it has to be."""
        try:
            arm = arm_from_urdf(case.text, case.joints, case.tip, planar=planar)
        except CalibError as error:
            message = one_line(str(error))
            assert refused, f"refused: {message}"
            assert refused in message, f"{refused!r} expected: {message}"
            return None
        assert not refused, f"loaded, but {refused}"
        return arm

    def _automatic(self, case: RandomArm, *, planar: bool = False) -> PlanarArm | SpatialArm | None:
        try:
            return arm_from_urdf(case.text, planar=planar)
        except CalibError as error:
            one_line(str(error))
            return None


@dataclass(frozen=True)
class UrdfCase:
    """The content of a file, and which joints and tip are asked for."""

    data: bytes
    joints: tuple[str, ...] | None = None
    tip: str | None = None


def _is_xml(data: bytes) -> bool:
    try:
        ET.fromstring(data.decode("utf-8-sig"))
    except (ET.ParseError, ValueError):
        return False
    return True


class Urdfs(Kind):
    """Damaged and hostile URDF files: an arm that is right, or one line."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.trap = Trap(folder)
        (folder / "meshes").mkdir()
        self.bases = [resolve_robot(name).read_bytes() for name in BUNDLED] + _installed()

    def close(self) -> None:
        """Close the trap."""
        self.trap.close()

    def make(self, rng: Random) -> UrdfCase:
        """Make the content of a URDF file, and joints and a tip that it may have."""
        joints: tuple[str, ...] | None = None
        tip = None
        pick = rng.random()
        if pick < 0.3:
            data = rng.choice(self.bases)
            names = [n.get("name", "") for n in ET.fromstring(data).iter("joint")]
            if rng.random() < 0.5:
                joints = tuple(rng.sample(names, min(len(names), rng.randint(1, 3))))
        elif pick < 0.7:
            arm = random_arm(rng)
            data, joints, tip = arm.text.encode(), tuple(arm.joints), arm.tip
        else:
            data = self.bases[rng.randrange(len(BUNDLED))]
        return UrdfCase(self._changed(rng, data), joints, tip)

    def _changed(self, rng: Random, data: bytes) -> bytes:
        way = rng.random()
        if way < 0.35:
            return damaged(rng, data)
        data = self._edited(rng, data)
        if way < 0.7:
            return data
        data = hostile(rng, data, self.trap.secret, self.trap.port)
        return damaged(rng, data, 1) if rng.random() < 0.2 else data

    def judge(self, case: UrdfCase) -> str:
        """Load the file; what loads has to agree with Pinocchio, where that reads it too."""
        path = self.folder / "robot.urdf"
        path.write_bytes(case.data)
        try:
            with guarded(self.folder):
                arm = load_arm(path, case.joints, case.tip)
                for note in arm.notes:
                    one_line(note)
                self._meshes(arm)
        except CalibError as error:
            self.trap.check()
            message = one_line(str(error))
            if "well-formed" in message:
                assert not _is_xml(case.data), message
            return "refused"
        self.trap.check()
        q = arm.forward((arm.lower + arm.upper) / 2)
        assert np.isfinite(q).all(), f"the tip is at {q}"
        try:
            mimics = {
                joint.name: (joint.mimic.leader, joint.mimic.multiplier, joint.mimic.offset)
                for joint in parse_urdf(arm.urdf).joints
                if joint.mimic
            }
            Truth(arm.urdf)
        except Exception:  # what Pinocchio refuses and calib mends has nothing to compare with
            return "loaded, not read by Pinocchio"
        if any("no <axis>" in note for note in arm.notes):  # Pinocchio may read it otherwise
            return "loaded, with a word about an axis"
        compare(arm, arm.urdf, mimics)
        return "loaded, right"

    def _meshes(self, arm: Arm) -> None:
        """Look up the meshes that the URDF names, as the preview does."""
        for _, kind, _, style in islice(shapes(arm.urdf), 20):
            if kind == "mesh":
                try:
                    found = resolve_mesh(style["file"], self.folder / "meshes")
                except CalibError as error:
                    one_line(str(error))
                else:
                    raise AssertionError(f"{style['file']!r} led to {found}")

    def _edited(self, rng: Random, data: bytes) -> bytes:
        """Change elements and attributes; the result is XML again."""
        robot = ET.fromstring(data)
        for _ in range(rng.randint(1, 4)):
            nodes = [n for n in robot.iter() if rng.random() < 0.9]
            joints = robot.findall("joint")
            node = rng.choice(joints if joints and rng.random() < 0.5 else nodes or [robot])
            children = list(node.iter())
            rng.choice(EDITS)(rng, robot, rng.choice(children))
        return ET.tostring(robot, encoding="utf-8")


BUNDLED = ("two_link", "two_link_full", "three_link", "polar", "scara")


def _installed() -> list[bytes]:
    """URDFs of real robots, where the package example-robot-data is installed."""
    from importlib.metadata import PackageNotFoundError, files

    try:
        listed = files("example-robot-data") or []
    except PackageNotFoundError:
        return []
    found = sorted(str(f.locate()) for f in listed if f.suffix == ".urdf")
    return [data for path in found if len(data := Path(path).read_bytes()) < 60_000]

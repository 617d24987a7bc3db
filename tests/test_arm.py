"""Planar arms: kinematics against closed forms, Pinocchio and finite differences."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from calib_cli.translation import as_typed
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import pinocchio_forward, random_joints

from calib.arm.candidates import Candidate, choose, find_tip
from calib.arm.loading import arm_from_urdf, load_arm
from calib.arm.ranges import one_turn
from calib.arm.robots import list_robots
from calib.arm.urdf import parse_urdf
from calib.errors import CalibError, OptionError, QueryError, RobotError

BUNDLED = [entry.name for entry in list_robots() if entry.name not in ("six_axis", "spatial_three")]
ANGLE = st.floats(-np.pi, np.pi)


def chain_urdf(*joints: str, tip: str = "0.2 0 0") -> str:
    """A serial robot: joints j1, j2, ... given by the inside of their elements, and a tip."""
    text = '<robot name="chain"><link name="l0"/>'
    for k, inside in enumerate(joints, 1):
        kind = "prismatic" if "<!--slide-->" in inside else "revolute"
        if "<!--endless-->" in inside:
            kind = "continuous"
        text += (
            f'<link name="l{k}"/><joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/>{inside}</joint>'
        )
    return text + (
        f'<link name="tip"/><joint name="mount" type="fixed"><parent link="l{len(joints)}"/>'
        f'<child link="tip"/><origin xyz="{tip}"/></joint></robot>'
    )


def turning(axis="0 0 1", xyz="0.3 0 0", lower="-1", upper="1", more="") -> str:
    return (
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>{more}'
    )


SLIDE, ENDLESS = "<!--slide-->", "<!--endless-->"


# --- kinematics -------------------------------------------------------------------------


@given(ANGLE, ANGLE)
def test_two_links_follow_the_closed_form(q1, q2):
    expected = [
        0.30 * np.cos(q1) + 0.25 * np.cos(q1 + q2),
        0.30 * np.sin(q1) + 0.25 * np.sin(q1 + q2),
    ]
    np.testing.assert_allclose(load_arm("two_link").forward([q1, q2]), expected, atol=1e-15)


@pytest.mark.parametrize("name", BUNDLED)
def test_forward_agrees_with_pinocchio(name):
    arm = load_arm(name)
    q = random_joints(arm, 500)
    assert np.abs(arm.forward(q) - pinocchio_forward(arm, q)).max() <= 1e-12


@pytest.mark.parametrize("name", BUNDLED)
def test_the_jacobian_agrees_with_finite_differences(name):
    arm = load_arm(name)
    q, step = random_joints(arm, 50), 1e-6
    numeric = np.stack(
        [
            (arm.forward(q + step * unit) - arm.forward(q - step * unit)) / (2 * step)
            for unit in np.eye(arm.dof)
        ],
        axis=-1,
    )
    np.testing.assert_allclose(arm.jacobian(q), numeric, atol=1e-9)


@pytest.mark.parametrize("name", BUNDLED)
def test_the_skeleton_ends_at_the_tip_and_keeps_the_links_lengths(name):
    arm = load_arm(name)
    q = random_joints(arm, 20)
    points = arm.points(q)
    assert points.shape == (20, arm.dof + 1, 3)
    np.testing.assert_allclose(arm.plane.project(points[:, -1]), arm.forward(q), atol=1e-14)
    flat = arm.plane.project(points)
    links = np.linalg.norm(np.diff(flat, axis=1), axis=2)
    for k, length in enumerate(arm.link_lengths.values()):
        if not (k + 1 < arm.dof and not arm.revolute[k + 1]):  # a slide changes the link before
            np.testing.assert_allclose(links[:, k], length, atol=1e-14)


def test_a_nearly_parallel_axis_is_computed_as_it_is():
    text = chain_urdf(turning(), turning(axis="0.00005 0 1"), tip="0.2 0 0.1")
    arm = arm_from_urdf(text)
    q = random_joints(arm, 200)
    assert np.abs(arm.forward(q) - pinocchio_forward(arm, q)).max() <= 1e-12


def test_one_vector_is_a_row_of_the_batch():
    arm = load_arm("three_link")
    q = random_joints(arm, 3)
    assert arm.forward(q[1]).shape == (2,)
    assert arm.jacobian(q[1]).shape == (2, 3)
    assert arm.points(q[1]).shape == (4, 3)
    np.testing.assert_array_equal(arm.forward(q[1]), arm.forward(q)[1])
    np.testing.assert_array_equal(arm.jacobian(q[1]), arm.jacobian(q)[1])


def test_large_batches_are_the_small_ones_in_a_row():
    arm = load_arm("two_link")
    q = random_joints(arm, 70_000)  # more than one chunk
    rows = [0, 65_535, 65_536, 69_999]
    np.testing.assert_array_equal(arm.forward(q)[rows], arm.forward(q[rows]))
    assert arm.forward(q[:0]).shape == (0, 2)


@given(ANGLE, st.integers(0, 2**32 - 1))
def test_turning_the_first_joint_turns_the_workspace(turn, seed):
    arm = load_arm("three_link")
    q = random_joints(arm, 5, seed)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    turned = arm.forward(q + np.array([turn, 0, 0]))
    np.testing.assert_allclose(turned, arm.forward(q) @ rotation.T, atol=1e-14)


@settings(max_examples=30, deadline=None)
@given(*[st.floats(-1, 1)] * 6)
def test_where_the_base_stands_does_not_change_the_arm(x, y, z, roll, pitch, yaw):
    """In the plane's frame, an arm mounted anywhere moves as a rigid copy of itself."""
    text = load_arm("two_link").urdf.replace(
        '<origin xyz="0 0 0" rpy="0 0 0"/>\n    <axis',
        f'<origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/>\n    <axis',
    )
    moved, arm = arm_from_urdf(text), load_arm("two_link")
    q = random_joints(arm, 10)
    one, other = moved.forward(q), arm.forward(q)
    distances = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (one, other)]
    np.testing.assert_allclose(*distances, atol=1e-12)
    # and the tip never leaves the plane
    np.testing.assert_allclose(moved.plane.distances(moved.points(q)[:, -1]), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("q", "word"),
    [
        ([1.0], "or (n, 2)"),
        ([[1.0, 2.0, 3.0]], "or (n, 2)"),
        (np.zeros((2, 2, 2)), "or (n, 2)"),
        (3.0, "or (n, 2)"),
        ([[0.1, 0.2], [np.nan, 0]], "row 1"),
        ([np.inf, 0], "row 0"),
        (["a", "b"], "numbers"),
        ([[1], [1, 2]], "numbers"),
    ],
)
@pytest.mark.parametrize("method", ["forward", "jacobian", "points"])
def test_wrong_joint_values_are_refused(method, q, word):
    with pytest.raises(QueryError) as caught:
        getattr(load_arm("two_link"), method)(q)
    assert word in str(caught.value)


# --- altered arms -----------------------------------------------------------------------


def test_a_longer_link_is_longer_and_nothing_else_changes():
    arm = load_arm("three_link")
    longer = arm.with_link_length("elbow", 0.30)
    assert longer.link_lengths == pytest.approx({"shoulder": 0.3, "elbow": 0.3, "wrist": 0.15})
    q = random_joints(arm, 50)
    angle = q[:, 0] + q[:, 1]
    shift = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(longer.forward(q) - arm.forward(q), shift, atol=1e-14)
    assert arm.link_lengths["elbow"] == pytest.approx(0.25)  # the old arm is left as it was


@pytest.mark.parametrize("name", BUNDLED)
def test_a_link_of_its_own_length_is_the_same_arm(name):
    arm = load_arm(name)
    q = random_joints(arm, 20)
    for joint, length in arm.link_lengths.items():
        same = arm.with_link_length(joint, length)
        np.testing.assert_allclose(same.forward(q), arm.forward(q), atol=1e-15)
        doubled = arm.with_link_length(joint, 2 * length)
        assert doubled.link_lengths[joint] == pytest.approx(2 * length)


def test_a_slides_link_is_what_it_carries():
    arm = load_arm("polar").with_link_length("slide", 0.2)
    np.testing.assert_allclose(arm.forward([0, 0.1]), [0.15 + 0.1 + 0.2, 0], atol=1e-15)


def test_a_moved_tip_moves_along_and_across_the_last_link():
    arm = load_arm("two_link").with_tip_offset(0.01, 0.02)
    q1, q2 = 0.4, 0.9
    along = np.array([np.cos(q1 + q2), np.sin(q1 + q2)])
    across = np.array([-along[1], along[0]])
    expected = load_arm("two_link").forward([q1, q2]) + 0.01 * along + 0.02 * across
    np.testing.assert_allclose(arm.forward([q1, q2]), expected, atol=1e-15)


@pytest.mark.parametrize(("joint", "length"), [("nope", 1.0), ("elbow", -1.0), ("elbow", np.nan)])
def test_impossible_lengths_are_refused(joint, length):
    with pytest.raises(OptionError, match=r"nope|-1|nan"):
        load_arm("two_link").with_link_length(joint, length)


def test_a_link_without_length_cannot_be_stretched():
    arm = arm_from_urdf(chain_urdf(turning(), turning(xyz="0 0 0.1"), turning()), ["j1", "j2"])
    with pytest.raises(OptionError, match="no length"):
        arm.with_link_length("j1", 0.2)


# --- ranges -----------------------------------------------------------------------------


def test_a_range_narrows_one_joint():
    arm = load_arm("two_link", ranges={"elbow": (0.5, 1.0)})
    np.testing.assert_allclose(arm.lower, [0, 0.5])
    np.testing.assert_allclose(arm.upper, [np.pi / 2, 1.0])
    again = arm.with_range({"elbow": (0.3, 2.0)})  # limits are the joint's, not the last range
    assert again.lower[1] == 0.3


def test_a_rounded_range_is_clipped_into_the_limits():
    assert load_arm("two_link", ranges={"shoulder": (0, 1.5708)}).upper[0] == np.pi / 2


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"elbow": (0, 1)}, ["elbow=0:1", "0.261799:2.61799"]),
        ({"elbow": (1, 0.5)}, ["elbow=1:0.5", "lower one first"]),
        ({"elbow": (1, 1)}, ["elbow=1:1"]),
        ({"elbow": (np.nan, 1)}, ["nan"]),
        ({"elbw": (0, 1)}, ["'elbw'", "did you mean elbow?"]),
    ],
)
def test_impossible_ranges_are_refused(ranges, words):
    with pytest.raises(OptionError) as caught:
        load_arm("two_link", ranges=ranges)
    for word in words:
        assert word in as_typed(str(caught.value))


def test_more_than_one_turn_becomes_one_turn_said_aloud():
    arm = arm_from_urdf(chain_urdf(turning(lower="-6.3", upper="6.3"), turning()))
    assert (arm.lower[0], arm.upper[0]) == (-np.pi, np.pi)
    assert arm.periodic == (True, False)
    assert any("'j1' can turn more than once" in note for note in arm.notes)
    # another turn than the one around 0 may be asked for
    other = arm.with_range({"j1": (3.0, 3.0 + np.pi)})
    assert other.periodic == (False, False)


def test_a_range_of_more_than_one_turn_is_said_aloud():
    text = chain_urdf(turning(lower="-10", upper="10"), turning())
    arm = arm_from_urdf(text, ranges={"j1": (0, 1)})
    assert arm.notes == ()
    wide = arm.with_range({"j1": (-8, 5), "j2": (0, 0.5)})
    assert wide.notes == (
        "joint 'j1' can turn more than once: one turn is used, -3.1416 to 3.1416 rad",
    )
    np.testing.assert_allclose(wide.upper, [np.pi, 0.5])
    assert arm.with_range({"j1": (-3, 3)}).notes == ()


@given(st.floats(-50, 50), st.floats(2e-3, 50))
def test_one_turn_lies_within_its_range_as_near_to_zero_as_it_can(lower, excess):
    upper = lower + 2 * np.pi + excess
    (first, last), note = one_turn("j1", (lower, upper))
    assert last - first == pytest.approx(2 * np.pi)
    assert lower - 1e-9 <= first < last <= upper + 1e-9
    nearest = np.clip(0.0, lower + np.pi, upper - np.pi)
    assert (first + last) / 2 == pytest.approx(nearest, abs=1e-9)
    assert f"{first:.4f} to {last:.4f} rad" in note


def test_one_turn_stays_within_limits_that_do_not_hold_zero_in_their_middle():
    arm = arm_from_urdf(chain_urdf(turning(lower="-1", upper="1e16"), turning()))
    assert arm.lower[0] == pytest.approx(-1)
    assert arm.upper[0] == pytest.approx(2 * np.pi - 1)


@pytest.mark.parametrize("upper", ["1e16", "inf", "INF"])
def test_a_continuous_or_boundless_joint_gets_one_turn(upper):
    endless = arm_from_urdf(chain_urdf(turning(more=ENDLESS), turning()))
    boundless = arm_from_urdf(chain_urdf(turning(lower="-" + upper, upper=upper), turning()))
    for arm in (endless, boundless):
        assert (arm.lower[0], arm.upper[0]) == (-np.pi, np.pi)
        assert any("one turn" in note for note in arm.notes)
    q = random_joints(endless, 100)
    assert np.abs(endless.forward(q) - pinocchio_forward(endless, q)).max() <= 1e-12


def test_a_range_mends_limits_that_are_missing():
    text = chain_urdf(turning(), turning(lower="2", upper="-2"))
    with pytest.raises(RobotError, match=r"inverted.*`ranges=\{'j2': \(LOWER, UPPER\)\}` \[rad\]"):
        arm_from_urdf(text)
    assert arm_from_urdf(text, ranges={"j2": (-2, 2)}).upper[1] == 2


# --- which joints, which tip ------------------------------------------------------------


def test_the_order_of_the_joints_does_not_matter():
    arm = load_arm("three_link", ["wrist", "shoulder", "elbow"])
    assert arm.joint_names == ("shoulder", "elbow", "wrist")
    assert load_arm("three_link", "elbow,shoulder").joint_names == ("shoulder", "elbow")


def test_other_joints_are_locked_at_neutral_or_where_told():
    arm = load_arm("three_link", ["shoulder", "wrist"])
    assert arm.locked == {"elbow": pytest.approx(np.deg2rad(15))}  # 0 clipped into its limits
    assert any("elbow=0.2618" in note for note in arm.notes)
    told = load_arm("three_link", ["shoulder", "wrist"], lock={"elbow": 1.0})
    assert told.locked == {"elbow": 1.0}
    full = load_arm("three_link")
    expected = full.forward([0.3, 1.0, -0.2])
    np.testing.assert_allclose(told.forward([0.3, -0.2]), expected, atol=1e-15)


def test_a_locked_joint_is_not_chosen():
    arm = load_arm("three_link", lock={"wrist": 0.5})
    assert arm.joint_names == ("shoulder", "elbow")
    assert arm.locked == {"wrist": 0.5}


def test_a_follower_is_held_where_its_leader_is():
    mimic = '<mimic joint="j2" multiplier="-2" offset="0.1"/>'
    text = chain_urdf(turning(), turning(), turning(more=mimic), turning())
    arm = arm_from_urdf(text, ["j1", "j4"], lock={"j2": 0.2})
    assert arm.locked == {"j2": 0.2, "j3": pytest.approx(-0.3)}


def test_an_arm_is_preferred_to_its_fingers():
    text = chain_urdf(
        turning(xyz="0 0 0.1"),
        turning(axis="0 1 0"),
        turning(axis="0 1 0"),
        turning(xyz="0.25 0 0", axis="1 0 0"),
        turning(xyz="0.02 0 0", axis="0 0 1"),
        tip="0.04 0 0",
    )
    assert arm_from_urdf(text, planar=True).joint_names == ("j2", "j3")


def test_two_slides_make_a_plane():
    arm = arm_from_urdf(chain_urdf(turning(axis="1 0 0") + SLIDE, turning(axis="0 2 0") + SLIDE))
    assert arm.revolute == (False, False)
    np.testing.assert_allclose(arm.forward([0.1, 0.2]), [0.6 + 0.2 + 0.1, 0.2], atol=1e-15)
    np.testing.assert_allclose(arm.jacobian([0.1, 0.2]), np.eye(2), atol=1e-15)


def test_what_had_to_be_chosen_is_said_aloud():
    text = chain_urdf(turning(), turning(), turning(axis="0 1 0"))
    assert arm_from_urdf(text, ["j1", "j2"]).notes == (
        "tip 'tip' was chosen (`tip` changes it)",
        "locked at neutral: j3=0 (`lock` changes it)",
    )
    assert arm_from_urdf(text, ["j1", "j2"], "tip", lock={"j3": 9}).notes == (
        "`lock={'j3': 9}` lies outside the joint's limits -1:1 [rad]",
    )
    assert load_arm("two_link", ["shoulder", "elbow"]).notes == ()


def test_a_robot_without_a_name_is_called_as_its_file(tmp_path):
    text = load_arm("two_link").urdf
    named = tmp_path / "left_arm.urdf"
    named.write_text(text)
    assert load_arm(named).name == "two_link"
    nameless = tmp_path / "right_arm.urdf"
    nameless.write_text(text.replace('name="two_link"', ""))
    arm = load_arm(nameless)
    assert arm.name == "right_arm"
    assert any("right_arm is used" in note for note in arm.notes)
    assert arm_from_urdf(nameless.read_text()).name == "robot"


def test_a_note_is_one_printable_line_whatever_the_joints_are_called():
    text = chain_urdf(turning(), turning(), turning(axis="0 1 0")).replace('"j3"', '"a&#13;b"')
    assert arm_from_urdf(text, ["j1", "j2"], "tip").notes == (
        "locked at neutral: a\\rb=0 (`lock` changes it)",
    )


def test_axes_may_point_to_either_side_of_the_plane():
    same = arm_from_urdf(chain_urdf(turning(), turning()))
    for axes, signs in ((("0 0 1", "0 0 -1"), (1, -1)), (("0 0 -1", "0 0 1"), (-1, 1))):
        arm = arm_from_urdf(chain_urdf(*(turning(axis=axis) for axis in axes)))
        q = np.array([0.3, -0.7])
        np.testing.assert_allclose(arm.forward(q), same.forward(q * signs), atol=1e-15)


def test_a_tip_may_be_named_by_its_joint():
    assert load_arm("two_link", tip="tip_mount").tip == "tip"


def test_an_arm_can_be_built_again_from_its_own_text():
    arm = load_arm("scara", ranges={"elbow": (0.1, 1)})
    ranges = dict(zip(arm.joint_names, zip(arm.lower, arm.upper, strict=True), strict=True))
    again = arm_from_urdf(arm.urdf, arm.joint_names, arm.tip, lock=arm.locked, ranges=ranges)
    q = random_joints(arm, 10)
    np.testing.assert_array_equal(again.forward(q), arm.forward(q))
    np.testing.assert_array_equal(again.lower, arm.lower)
    np.testing.assert_array_equal(again.upper, arm.upper)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"joints": ["sholder", "elbow"]}, ["'sholder'", "did you mean shoulder?"]),
        ({"joints": ["shoulder", "tip_mount"]}, ["'tip_mount' is fixed", "shoulder, elbow"]),
        ({"joints": ["elbow"]}, ["two or more"]),
        ({"joints": []}, ["two or more"]),
        ({"joints": ["elbow", "elbow"]}, ["'elbow' twice"]),
        ({"tip": "tp"}, ["'tp'", "did you mean tip?"]),
        ({"tip": "upper_arm"}, ["'upper_arm'", "shoulder"]),
        ({"joints": ["shoulder", "elbow"], "tip": "upper_arm"}, ["'elbow'", "'upper_arm'"]),
        ({"joints": ["shoulder", "elbow"], "tip": "forearm"}, ["'elbow'", "'forearm'", "axis"]),
        ({"lock": {"nope": 1}}, ["`lock`", "'nope'"]),
        ({"lock": {"elbow": np.inf}, "joints": ["shoulder", "elbow"]}, ["elbow", "inf"]),
        ({"lock": {"elbow": 1.0}, "joints": ["shoulder", "elbow"]}, ["active and locked"]),
        ({"lock": {"elbow": 1.0}}, ["no planar arm", "shoulder, elbow"]),
    ],
)
def test_joints_and_tips_that_cannot_be_are_told_in_one_line(options, words):
    with pytest.raises(CalibError) as caught:
        load_arm("two_link", **options)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


NO_TIP = chain_urdf(turning(), turning(), tip="0 0 0")
STUCK_CHAIN = chain_urdf(turning(lower="0", upper="0"), turning())
SIDE_BY_SIDE = (
    '<robot name="r"><link name="o"/><link name="l"/><link name="m"/>'
    f'<joint name="a" type="revolute"><parent link="o"/><child link="l"/>{turning()}</joint>'
    f'<joint name="b" type="revolute"><parent link="o"/><child link="m"/>{turning()}</joint>'
    "</robot>"
)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        # two joints, but whatever the last one carries lies on its axis
        (NO_TIP, {}, ["'j2'", "lies on its axis", "add a tip link"]),
        (NO_TIP, {"tip": "tip"}, ["'tip' lies on its axis", "add a tip link"]),
        (chain_urdf(turning(), turning()), {"tip": "l2"}, ["'l2' lies on its axis", "from tip"]),
        # two joints side by side
        (SIDE_BY_SIDE, {}, ["in one chain", "a, b"]),
        # limits that leave no room: named only where they are the reason
        (STUCK_CHAIN, {}, ["j1", "no room (0 to 0)", "`ranges={'j1': (LOWER, UPPER)}`"]),
        (STUCK_CHAIN, {"lock": {"j2": 0.0}}, ["in one chain", "j2 is locked"]),
    ],
)
def test_the_reason_for_finding_no_arm_is_the_true_one(text, options, words):
    with pytest.raises(RobotError) as caught:
        arm_from_urdf(text, **options)
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_joints_that_their_limits_hold_move_once_they_are_given_a_range():
    arm = arm_from_urdf(STUCK_CHAIN, ranges={"j1": (-1, 1)})
    assert arm.joint_names == ("j1", "j2")
    assert arm.lower[0] == -1


def test_an_arm_that_is_not_planar_is_refused_naming_the_joint_and_its_axis():
    text = chain_urdf(turning(), turning(axis="0 1 0"), turning())
    with pytest.raises(RobotError, match=r"not planar: joint 'j2' has the axis \(0, 1, 0\)"):
        arm_from_urdf(text, ["j1", "j2", "j3"], planar=True)
    sliding = chain_urdf(turning(), turning() + SLIDE)
    with pytest.raises(RobotError, match=r"'j2' has the axis \(0, 0, 1\).*perpendicular"):
        arm_from_urdf(sliding, ["j1", "j2"], planar=True)
    in_line = chain_urdf(turning() + SLIDE, turning() + SLIDE)
    with pytest.raises(RobotError, match="all slide along"):
        arm_from_urdf(in_line, ["j1", "j2"])


@pytest.mark.parametrize(("angle", "planar"), [(0.9e-4, True), (1.1e-4, False)])
def test_axes_may_differ_by_a_ten_thousandth(angle, planar):
    text = chain_urdf(turning(), turning(axis=f"{np.sin(angle)} 0 {-np.cos(angle)}"))
    if planar:
        assert arm_from_urdf(text, ["j1", "j2"]).joint_names == ("j1", "j2")
    else:
        assert arm_from_urdf(text, ["j1", "j2"]).outputs == 3
        with pytest.raises(RobotError, match="not planar"):
            arm_from_urdf(text, ["j1", "j2"], planar=True)


def test_like_arms_are_listed_and_every_suggestion_works():
    text = '<robot name="pair"><link name="base"/>'
    for side in "lr":
        one = chain_urdf(turning(), turning()).removeprefix('<robot name="chain">')
        one = one.removesuffix("</robot>").replace('name="', f'name="{side}_')
        text += one.replace('link="', f'link="{side}_') + (
            f'<joint name="{side}_base" type="fixed"><parent link="base"/>'
            f'<child link="{side}_l0"/></joint>'
        )
    text += "</robot>"
    with pytest.raises(RobotError) as caught:
        arm_from_urdf(text)
    assert "--joints l_j1,l_j2 --tip l_tip; --joints r_j1,r_j2 --tip r_tip" in as_typed(
        str(caught.value)
    )
    assert arm_from_urdf(text, ["r_j1", "r_j2"], "r_tip").joint_names == ("r_j1", "r_j2")
    assert arm_from_urdf(text, tip="l_tip").joint_names == ("l_j1", "l_j2")


def test_an_active_follower_or_leader_is_refused():
    mimic = '<mimic joint="j2"/>'
    text = chain_urdf(turning(), turning(), turning(more=mimic))
    with pytest.raises(RobotError, match=r"'j3' mimics 'j2' and cannot move on its own"):
        arm_from_urdf(text, ["j1", "j3"])
    for joints in (["j1", "j2"], None):
        with pytest.raises(RobotError, match=r"'j3' mimics the active 'j2'"):
            arm_from_urdf(text, joints, planar=True)


def test_without_pinocchio_the_remedy_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(RobotError, match="pip install pin"):
        load_arm("two_link")


# --- found by changing the code and seeing no test fail ---------------------------------

BENT = chain_urdf(turning(), turning(), tip="0.12 0.16 0")  # the last link is 0.2 m, bent
SLIDING_TIP = chain_urdf(turning(), turning(axis="1 0 0") + SLIDE, tip="0 0 0")


@pytest.mark.parametrize("text", [BENT, *(load_arm(name).urdf for name in BUNDLED)])
def test_a_moved_tip_is_told_by_the_last_link_wherever_that_points(text):
    arm = arm_from_urdf(text)
    q = random_joints(arm, 20)
    flat = arm.plane.project(arm.points(q))
    link = flat[:, -1] - flat[:, -2]
    if not arm.revolute[-1]:  # its zero posture's link, which the slide's travel is not part of
        link = link / np.linalg.norm(link, axis=1, keepdims=True)
    along = link / np.linalg.norm(link, axis=1, keepdims=True)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    moved = arm.with_tip_offset(0.03, -0.02).forward(q) - arm.forward(q)
    np.testing.assert_allclose(moved, 0.03 * along - 0.02 * left, atol=1e-14)


def test_a_tip_on_its_slide_is_moved_along_the_planes_axes():
    arm = arm_from_urdf(SLIDING_TIP)
    moved = arm.with_tip_offset(0.03, -0.02).forward([0.0, 0.1]) - arm.forward([0.0, 0.1])
    np.testing.assert_allclose(moved, [0.03, -0.02], atol=1e-15)


@pytest.mark.parametrize("offset", [(np.nan, 0.0), (0.0, np.inf)])
def test_a_tip_is_moved_by_finite_numbers_only(offset):
    with pytest.raises(OptionError, match=r"tip offset .*expected two finite numbers"):
        load_arm("two_link").with_tip_offset(*offset)


@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0])
def test_a_joint_may_be_locked_up_to_its_limits_in_silence(value):
    text = chain_urdf(turning(), turning(), turning())
    arm = arm_from_urdf(text, ["j1", "j2"], "tip", lock={"j3": value})
    assert arm.locked == {"j3": value}
    assert arm.notes == ()


def test_a_locked_joint_off_the_way_to_the_tip_is_said_aloud():
    text = chain_urdf(turning(), turning(), turning())
    arm = arm_from_urdf(text, ["j1", "j2"], "l3", lock={"j3": 0.5})
    assert arm.locked == {"j3": 0.5}
    idle = arm_from_urdf(text, ["j1", "j2"], "mount", lock={"j3": 0.5})
    assert idle.notes == ()
    aside = branching(turning("0 0 1", "0 0.1 0"), "aside")
    assert arm_from_urdf(aside, ["j1", "j2"], "tip", lock={"aside": 0.1}).notes == (
        "locked joints that do not move the tip: aside",
    )


def branching(inside: str, *names: str, kind: str = "revolute") -> str:
    """Two joints and a tip; further links of these names hang on the second joint's link."""
    text = chain_urdf(turning(), turning()).removesuffix("</robot>")
    for name in names:
        text += (
            f'<link name="{name}_link"/><joint name="{name}" type="{kind}">'
            f'<parent link="l2"/><child link="{name}_link"/>{inside}</joint>'
        )
    return text + "</robot>"


def test_at_a_branching_a_tools_name_is_followed_or_else_the_only_way_with_joints():
    far = '<origin xyz="0.1 0 0"/>'
    plain = parse_urdf(branching(far, "camera", kind="fixed"))
    assert find_tip(plain, "l1") == "tip"  # the usual name of a tip
    odd = branching(far, "camera", kind="fixed").replace('"tip"', '"lamp"')
    assert find_tip(parse_urdf(odd), "l1") == "l2"  # neither is better
    assert find_tip(parse_urdf(odd.replace("camera_link", "my_TCP")), "l0") == "my_TCP"
    two = odd.replace("camera_link", "left_tool0").replace('"lamp"', '"right_tool0"')
    assert find_tip(parse_urdf(two), "l0") == "l2"
    # a cover beside the one link that goes on moving
    onward = branching(turning(), "wrist").replace('"tip"', '"cover"')
    assert find_tip(parse_urdf(onward), "l0") == "wrist_link"
    # a fixed part that carries a joint counts as well as a joint does
    mounted = parse_urdf(
        odd.replace(
            "</robot>",
            '<link name="end"/><joint name="j" type="revolute"><parent link="camera_link"/>'
            f'<child link="end"/>{turning()}</joint></robot>',
        )
    )
    assert find_tip(mounted, "l0") == "end"


USUAL = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")


@pytest.mark.parametrize("name", [form for n in USUAL for form in (n, f"left_{n.upper()}")])
def test_every_usual_name_of_a_tip_is_followed(name):
    text = branching('<origin xyz="0.1 0 0"/>', "camera", kind="fixed").replace('"tip"', '"lamp"')
    for order in (("camera_link", name), ("lamp", name)):
        assert find_tip(parse_urdf(text.replace(*order)), "l0") == name


@pytest.mark.parametrize("name", ["tool0_cover", "tips", "end_effectors", "see_through"])
def test_a_name_that_only_holds_a_usual_one_is_none(name):
    text = branching('<origin xyz="0.1 0 0"/>', "camera", kind="fixed").replace('"tip"', '"lamp"')
    assert find_tip(parse_urdf(text.replace("camera_link", name)), "l0") == "l2"


@pytest.mark.parametrize("others", [1, 2, 3, 4, 9])
def test_the_next_three_arms_are_named_beside_the_one_that_is_chosen(others):
    joints = parse_urdf(chain_urdf(*[turning()] * (others + 1))).joints
    small = [Candidate((joints[k],), "tip", 0.4 - 0.01 * k) for k in range(1, others + 1)]
    best, note = choose([Candidate((joints[0],), "tip", 1.0), *small])
    assert as_typed(str(best)) == "--joints j1 --tip tip"
    named = "; ".join(f"--joints j{k + 2} --tip tip" for k in range(min(others, 3)))
    more = "; ..." if others > 3 else ""
    shown = f"chosen by reach: --joints j1 --tip tip (others: {named}{more})"
    assert as_typed(str(note)) == shown


def test_the_only_arm_is_chosen_without_a_word():
    joints = parse_urdf(chain_urdf(turning())).joints
    only = Candidate(joints[:1], "tip", 1.0)
    assert choose([only]) == (only, None)


def test_a_tip_on_the_axis_is_told_with_those_that_are_off_it():
    with pytest.raises(RobotError) as caught:
        load_arm("two_link", ["shoulder", "elbow"], "forearm")
    assert str(caught.value).endswith("choose a tip off the axis from tip")
    text = NO_TIP.replace("tip", "end")
    with pytest.raises(RobotError, match=r"does not move the tip 'end'.*or add a tip link"):
        arm_from_urdf(text, ["j1", "j2"], "end")


def test_without_a_tip_the_reason_speaks_of_none():
    with pytest.raises(RobotError, match=r"^no planar arm: joint 'j2' is the last"):
        arm_from_urdf(NO_TIP)
    with pytest.raises(RobotError, match=r"^no planar arm that moves 'tip': joint 'j2'"):
        arm_from_urdf(NO_TIP, tip="tip")


def test_all_joints_without_limits_are_asked_for_at_once():
    text = chain_urdf(*[turning().split("<limit")[0]] * 2)
    with pytest.raises(RobotError) as caught:
        arm_from_urdf(text)
    for joint in ("j1", "j2"):
        assert f"joint '{joint}' cannot be babbled, it states no limits" in str(caught.value)
        assert f"--range {joint}=LOWER:UPPER" in as_typed(str(caught.value))
    arm = arm_from_urdf(text, ranges={"j1": (-1, 1), "j2": (0, 1)})
    np.testing.assert_array_equal([arm.lower, arm.upper], [[-1, 0], [1, 1]])


def test_a_slides_range_is_a_travel_that_can_be_and_a_turns_is_one_turn():
    endless = turning(axis="1 0 0", lower="-1e9", upper="1e9")
    text = chain_urdf(turning(lower="-1e9", upper="1e9"), endless + SLIDE)
    with pytest.raises(OptionError, match=r"j2.*2000.*expected a travel of at most 1000 m"):
        arm_from_urdf(text, ["j1", "j2"], ranges={"j2": (0, 2000)})
    arm = arm_from_urdf(text, ["j1", "j2"], ranges={"j2": (-500, 500), "j1": (-5000, 5000)})
    assert (arm.lower[1], arm.upper[1]) == (-500, 500)
    np.testing.assert_allclose([arm.lower[0], arm.upper[0]], [-np.pi, np.pi])
    with pytest.raises(RobotError, match=r"limits are unusable.*ranges=.*j2"):
        arm_from_urdf(text, ["j1", "j2"])


def test_of_three_joints_in_a_plane_the_last_is_the_one_named():
    text = chain_urdf(turning(), turning(), turning(), tip="0 0 0").replace(
        'name="j2" type="revolute"', 'name="j2" type="fixed"'
    )
    with pytest.raises(RobotError, match=r"joint 'j3' is the last of its plane"):
        arm_from_urdf(text)


def test_only_the_first_six_of_like_arms_are_listed():
    text = '<robot name="many"><link name="base"/>'
    for side in "abcdefg":
        one = chain_urdf(turning(), turning()).removeprefix('<robot name="chain">')
        one = one.removesuffix("</robot>").replace('name="', f'name="{side}_')
        text += one.replace('link="', f'link="{side}_') + (
            f'<joint name="{side}_base" type="fixed"><parent link="base"/>'
            f'<child link="{side}_l0"/></joint>'
        )
    with pytest.raises(RobotError) as caught:
        arm_from_urdf(text + "</robot>")
    message = str(caught.value)
    assert "the robot has 7 planar arms" in message
    assert message.count("`joints=") == 6
    assert message.endswith("; ...")

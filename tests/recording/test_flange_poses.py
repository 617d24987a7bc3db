"""Hand-eye from a controller's flange poses: conventions, boards, cameras, what is not known."""

import itertools
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from boards import CONVENTIONS, SIZE, World, misses, motion, pictures_of
from conftest import refused
from scipy.spatial.transform import Rotation

import calib


@pytest.mark.parametrize("in_hand", [True, False])
def test_camera_board_and_lens_are_found_with_intervals_that_hold(in_hand):
    inside = []
    for seed in range(4):
        world = World(seed, in_hand)
        turned = (1, 4, 5) if seed % 2 else ()  # a board that looks the same from its other end
        rig = world.solve(turned=turned)
        inside.append(world.misses(rig) < 1.0)
        assert rig.used == world.count
        assert rig.convention["rotation"] == "matrix"
        assert not rig.convention["inverse"]
        assert 1e-4 < rig.repeatability["position"] < 6e-4
        assert abs(rig.lens["focal"] - 901.5) < 2.0 * rig.lens["focal_95"] + 0.5
        assert rig.held_out["rms"] < 3.0
    assert np.mean(inside) > 0.85


@pytest.mark.parametrize("rotation", list(CONVENTIONS))
def test_what_a_table_means_is_found(rotation, tmp_path):
    number = list(CONVENTIONS).index(rotation)
    world = World(20 + number, number % 2 == 0, 12)
    unit, factor = (("mm", 1000.0), ("m", 1.0), ("in", 1 / 0.0254))[number % 3]
    told = np.linalg.inv(world.flange) if number % 2 else world.flange
    turns = CONVENTIONS[rotation](Rotation.from_matrix(told[:, :3, :3]))
    rows = np.column_stack([factor * told[:, :3, 3], turns])
    if turns.shape[1] == 9:  # matrices (3, 4) by rows
        places = factor * told[:, :3, 3:]
        rows = np.concatenate([turns.reshape(-1, 3, 3), places], axis=2).reshape(-1, 12)
    table = tmp_path / "flange.csv"
    np.savetxt(table, rows, delimiter=",")
    rig = world.solve(table)
    if "not told apart" not in " ".join(rig.notes):
        expected = {"rotation": rotation, "unit": unit, "inverse": bool(number % 2)}
        assert rig.convention | expected == rig.convention
        assert rig.convention["ratio"] > 1.3
    if rotation == "rpy":  # what is said is taken
        for said in ("rpy", "fanuc"):
            assert world.solve(table, rotation=said, unit=unit).convention["rotation"] == "rpy"
    refused(calib.OptionError, "rotation", world.solve, table, rotation="other")


def test_few_pictures_fit_one_reading_although_three_of_them_fit_any():
    for count, seed in itertools.product((4, 5), (1, 3, 5, 19)):
        convention = World(seed, seed % 2 == 0, count=count).solve().convention
        assert not convention["inverse"]
        assert convention["ratio"] > 5.0


OF_FIVE = [  # seeds, how the arm repeats, which of shifts and turns, share within the intervals
    (range(28, 40), {}, slice(3, 6), 0.9),  # turns that so few cannot tell
    (range(30), {"shift": 1e-4, "turn": np.radians(0.05)}, slice(0, 6), 0.94),  # once 91 %
]


@pytest.mark.parametrize(("seeds", "repeating", "part", "share"), OF_FIVE)
def test_intervals_of_five_pictures_contain_the_truth(seeds, repeating, part, share):
    worlds = [World(seed, seed % 2 == 0, count=5, **repeating) for seed in seeds]
    misses = np.reshape([world.misses(world.solve()) for world in worlds], (-1, 2, 6))
    assert np.mean(misses[:, :, part] < 1.0) > share


def test_threads_of_opencv_leave_no_trace():
    threads = cv2.getNumThreads()
    cv2.setNumThreads(4)
    lenses = {World(3).shots().lens().parameters.tobytes() for _ in range(8)}
    assert cv2.getNumThreads() == 4
    cv2.setNumThreads(threads)
    assert len(lenses) == 1


def test_misses_are_told_of_pictures_that_took_no_part_in_the_fit():
    """The poses' own noise makes .9 px; six pictures in one fit miss by .6."""
    rms = [World(seed, seed % 2 == 0, count=6).solve().held_out["rms"] for seed in range(1, 7)]
    assert 0.85 < np.mean(rms) < 1.3


@pytest.mark.parametrize("seed", [1, 3])
def test_a_table_one_row_late_along_a_path_is_refused(seed):
    world = World(seed, seed % 2 == 0, count=0)
    phase = np.random.default_rng(seed).uniform(0.0, 6.0, (2, 3))
    for at in 2 * np.pi * np.linspace(0.0, 1.0, 40):
        turn = Rotation.from_rotvec(0.44 * np.sin(at * np.array([1.0, 1.3, 0.7]) + phase[0]))
        swing = np.sin(at * np.array([0.8, 1.1, 1.0]) + phase[1])
        world.show(turn, np.array([0.0, 0.0, 0.45]) + (0.1, 0.05, 0.1) * swing)
    assert world.solve().used > 0.9 * world.count
    refused(calib.LogError, "late or early: those", world.solve, np.roll(world.flange, -1, axis=0))


@pytest.mark.parametrize("factor", [0.01, 0.1, 10.0, 100.0])
def test_a_board_stated_in_another_unit_is_measured_and_no_unit_of_poses(factor):
    world = World(4)
    shots = world.shots()
    board = replace(shots.board, side=factor * shots.board.side)
    rig = world.solve(shots=replace(shots, board=board))
    assert rig.convention["unit"] == "m"
    assert abs(rig.square["measured"] - 0.022) < 2e-4
    assert any("squares measure" in note for note in rig.notes)
    assert (misses(rig.hand, world.camera) < 1.5).all()


def test_pictures_at_one_pose_are_one_measurement_of_the_arm():
    world, rng = World(1, count=8), np.random.default_rng(0)
    rig = world.solve()
    world.flange = np.tile(world.flange, (3, 1, 1))
    world.corners = [[c + rng.normal(0.0, 0.1, c.shape) for c in world.corners[0] * 3]]
    again = world.solve()
    assert again.used == again.pictures == 24
    assert len(again.names) == 8
    shares = np.divide(again.hand["position_95"], rig.hand["position_95"])
    assert 0.7 < shares.mean() < 1.4
    three = World(1, count=3)
    three.flange, three.corners = np.tile(three.flange, (2, 1, 1)), [three.corners[0] * 2]
    refused(calib.LogError, "of 3 poses of the arm: expected 4", three.solve)


def test_rows_that_are_wrong_are_left_out_but_no_corner_and_a_late_table_is_refused():
    world = World(4)
    wrong = world.flange.copy()
    wrong[-1, :3, 3] += (0.02, -0.01, 0.03)
    rig = world.solve(wrong)
    assert rig.left_out == ("15.png",)
    assert "left out (15.png): in them" in " ".join(rig.notes)  # one is no change from then on
    # where the hand turns little, they passed for an arm that repeats badly: 24 mm
    doubtful = World(8, count=15, spread=12.0)
    doubtful.flange[[3, 9]] = doubtful.flange[[9, 3]]
    assert doubtful.solve().left_out == ("03.png", "09.png")
    exchanged = world.flange[[*range(3), 9, *range(4, 9), 3, *range(10, 16)]]
    assert world.solve(exchanged).left_out == ("03.png", "09.png")
    refused(calib.LogError, "late or early: those", world.solve, np.roll(world.flange, 1, axis=0))
    few = World(5, count=5)  # of which no fit leaves some out
    words = "exchanged: those of 01.png and 03.png"
    refused(calib.LogError, words, few.solve, few.flange[[0, 3, 2, 1, 4]])
    # one wrong corner is no wrong picture, and one pose twice no two
    world.corners[0][5][7] += (30.0, -20.0)
    assert world.solve().used == 16
    twice = world.flange.copy()
    twice[9] = twice[8]
    assert world.solve(twice).left_out == ("09.png",)


def test_a_board_that_was_moved_among_few_pictures_is_told_from_an_arm_that_repeats_badly():
    """Poses agreed to 6 and 17 mm, and no picture was left out."""
    for seed in (6, 8):
        world = World(seed, count=8)
        world.placed = world.placed @ motion(Rotation.from_rotvec([0.03, 0.0, 0.02]), [0.02] * 3)
        while world.count < 12:
            turn = Rotation.from_rotvec(world.rng.uniform(-0.6, 0.6, 3))
            world.show(turn, np.array([0.0, 0.0, 0.45]) + world.rng.uniform(-0.05, 0.05, 3))
        rig = world.solve()
        assert rig.left_out == ("08.png", "09.png", "10.png", "11.png")
        assert "agree to" not in " ".join(rig.notes)
        six = pictures_of(world.pattern, world.corners[0][5:11])
        few = world.solve(world.flange[5:11], shots=six)
        words = "camera or board was moved (which 6 poses may not show: add pictures)"
        assert words in " ".join(few.notes)


def test_a_board_that_slipped_is_told_before_a_focus_that_looks_as_if_it_changed():
    world = World(0, count=7)
    slip = motion(Rotation.from_rotvec(np.radians([0.09, -0.12, 0.26])), [1.2e-3, 1.6e-3, 0.0])
    world.placed = slip @ world.placed
    while world.count < 14:
        turn = Rotation.from_rotvec(world.rng.uniform(-0.65, 0.65, 3))
        world.show(turn, world.rng.uniform([-0.12, -0.07, 0.3], [0.12, 0.07, 0.6]))
    notes = " ".join(world.solve().notes)
    assert 0 < notes.index("camera or board was moved") < notes.index("autofocus")


@pytest.mark.parametrize("seed", [1, 5, 10, 11])
def test_few_pictures_tell_turns_of_the_arm_from_shifts_and_from_noise_of_corners(seed):
    """Turns of .1 deg ended at none."""
    rig = World(seed, seed % 2 == 0, count=6, turn=np.radians(0.1)).solve()
    assert np.radians(0.05) < rig.repeatability["rotation"] < np.radians(0.15)


@pytest.mark.parametrize("seed", [36, 93])
def test_of_several_noises_that_fit_the_one_that_predicts_other_pictures_is_taken(seed):
    world = World(seed, seed % 2 == 0, count=8)
    rng = np.random.default_rng([9, seed])
    for k, corners in enumerate(world.corners[0]):  # they err together: 2.4 and 2.5 px before
        along = (corners - corners.mean(axis=0)) / np.ptp(corners)
        world.corners[0][k] = corners + rng.normal(0, 0.6, 2) + along @ rng.normal(0, 1, (2, 2))
    assert world.solve().held_out["rms"] < 2.1


def test_a_weak_camera_is_as_noisy_as_its_corners():
    """Its noise of 3 px was taken for 9: the pictures were refused."""
    world = World(0, count=20, second=True)
    noise = world.rng.normal(0.0, 3.0, np.shape(world.corners[1]))
    shots = {"good": world.shots(), "weak": pictures_of(world.pattern, world.corners[1] + noise)}
    rig = world.solve(shots=shots)
    assert rig.used == 20
    assert (misses(rig.cameras[1]["from_first"], world.apart) < 2.0).all()


def test_a_lens_that_refocuses_and_a_stretched_board_are_part_of_the_fit_and_no_blur():
    for what, size in (("focus", 5e-3), ("stretch", 4e-3)):
        world = World(1, **{what: size})
        rig = world.solve()
        assert ("focal length changes by 0." in " ".join(rig.notes)) == (what == "focus")
        assert max(rig.hand["position_95"]) < 1e-3
        assert (misses(rig.hand, world.camera) < 2.0).all()
    world, rng = World(2), np.random.default_rng(7)
    world.corners = [[seen + rng.normal(0.0, 3.0, seen.shape) for seen in world.corners[0]]]
    notes = " ".join(world.solve().notes)
    assert "corners are off by" in notes
    assert "autofocus" not in notes


@pytest.mark.parametrize("in_hand", [True, False])
def test_planned_poses_show_the_board_and_tell_what_is_promised(in_hand, tmp_path, run):
    world = World(0, in_hand, axes=(0.5, 0.05, 1.0))
    rig = world.solve()
    rig.save(tmp_path / "rig.calib")
    words = ("--handeye", "-n", 2, "-o", tmp_path / "p.csv", "--json")
    done = run.done("plan", tmp_path / "rig.calib", *words)
    assert run("plan", tmp_path / "rig.calib", *words, "--above", 0.1).code == 2
    poses = done.document["poses"]
    shifts = np.column_stack([poses[name] for name in "xyz"])
    turns = Rotation.from_quat(np.column_stack([poses[f"q{name}"] for name in "xyzw"]))
    for turn, shift in zip(turns, shifts, strict=True):
        world.take_picture(motion(turn, shift))
    after = np.max(world.solve().hand["position_95"])
    assert after < 0.75 * np.max(rig.hand["position_95"])
    assert after < 1.2 * np.max(done.document["position_95"][-1])


def test_of_squares_that_were_counted_wrong_the_right_ones_are_named():
    squares = np.indices((6, 9)).sum(axis=0) % 2
    page = np.pad(np.kron(squares, np.ones((30, 30))), 30, constant_values=1)
    pictures = [(255 * page).astype(np.uint8)] * 4
    poses = np.tile(np.eye(4), (4, 1, 1))
    words = "give `board='9x6:22mm'`, which"
    refused(calib.LogError, words, calib.handeye, pictures=pictures, poses=poses, board="8x6:22mm")


def test_mirrored_pictures_and_turns_about_one_axis_are_refused_with_what_would_tell():
    world = World(1)
    mirrored = [corners * (-1, 1) + (SIZE[0], 0) for corners in world.corners[0]]
    world.corners[0] = [c.reshape(6, 9, 2)[:, ::-1].reshape(-1, 2) for c in mirrored]
    refused(calib.LogError, "mirrored", world.solve)
    refused(calib.LogError, "turns about one axis alone", World(3, axes=(0.0, 0.0, 1.0)).solve)
    for seed in (2, 5):  # of so few two passed for exchanged
        few = World(seed, axes=(1.0, 0.0, 0.0), count=7)
        refused(calib.LogError, "turns about one axis alone", few.solve)
    world = World(3)
    seen = world.boards
    seen[:, :3, :3] = seen[0, :3, :3]
    flange = np.linalg.inv(world.camera @ seen @ np.linalg.inv(world.placed))
    refused(calib.LogError, "does not turn", calib.handeye, poses=flange, boards=seen, eye="hand")


def test_poses_of_the_board_alone_are_enough():
    world = World(1)
    seen, rng = world.boards, np.random.default_rng(0)
    rig = calib.handeye(poses=world.flange, boards=seen, eye="hand")
    np.testing.assert_allclose(rig.hand["position"], world.camera[:3, 3], atol=1e-6)
    hole, flange = np.where(np.arange(len(seen))[:, None, None] == 3, np.nan, 1.0), world.flange
    for words, boards, poses in (
        ("z > 0", -seen, flange),
        (r"boards\[3\] holds what is no number", hole * seen, flange),
        (r"poses\[3\] holds what is no number", seen, hole * flange),
        ("boards: 16, poses: 15: expected a board of each pose", seen, flange[1:]),
        ("boards: 15, poses: 16", seen[1:], flange),  # the last pose was ignored
    ):
        refused(calib.OptionError, words, calib.handeye, poses=poses, boards=boards, eye="hand")
    in_mm = seen.copy()
    in_mm[:, :3, 3] *= 1e3
    rig = calib.handeye(poses=flange, boards=in_mm, eye="hand")
    assert "1000 times too long by the arm's motions, as where they are in mm" in str(rig.notes)
    # of small tags: with their scatter, and their size
    seen[:, :3, :3] @= Rotation.from_rotvec(rng.normal(0.0, 0.06, (len(seen), 3))).as_matrix()
    seen[:, :3, 3] *= 1.02
    rig = calib.handeye(poses=world.flange, boards=seen, eye="hand")
    assert (misses(rig.hand, world.camera) < 1.5).all()
    notes = " ".join(rig.notes)
    assert re.search(r"shifts of the boards are [1-3](\.\d)? % too long", notes)
    assert "a small or blurred tag" in notes


def test_two_cameras_come_out_of_one_folder(tmp_path, run, monkeypatch):
    world = World(7, in_hand=False, count=10, second=True)
    for number, name in enumerate(("left", "right")):
        (tmp_path / "rig" / name).mkdir(parents=True)
        for k in range(world.count + 1):
            mark = np.full((SIZE[1], SIZE[0]), 10 * number, np.uint8)
            mark[0, 1] = k
            cv2.imwrite(str(tmp_path / "rig" / name / f"{k}.png"), mark)

    def find(board, grey):  # drawing the pictures takes longer than all the rest
        seen = [*world.corners[grey[0, 0] // 10], ()]  # nothing in the last picture
        return dict(enumerate(seen[grey[0, 1]]))

    monkeypatch.setattr("calib.recording.board.Chessboard.find", find)
    np.savetxt(tmp_path / "flange.txt", world.flange[[*range(10), 0]].reshape(-1, 16))
    words = ["--poses-file", tmp_path / "flange.txt", "--board", world.board, "--eye", "base"]
    made = ("--transform", tmp_path / "t.json", "--json")
    done = run.done("handeye", tmp_path / "rig", *words, *made)
    assert re.search("note: left: no board(.*\n)+note: right: no board", done.err)
    left, right = done.document["cameras"]
    assert (left["name"], right["name"]) == ("left", "right")
    assert (misses(left["base"], world.camera) < 2.0).all()
    assert (misses(right["from_first"], world.apart) < 2.0).all()
    assert "static_transform_publisher" in (tmp_path / "t.txt").read_text()
    run.done("handeye", tmp_path / "rig", *words, "-o", tmp_path / "rig.calib")
    refused(calib.ModelError, "a rig of flange poses", calib.load, tmp_path / "rig.calib")
    run.refused(1, "right", "handeye", tmp_path / "rig", *words[:-1], "left=base,right=other")
    swapped = run("handeye", tmp_path / "rig", *words[:-1], "hand")
    assert swapped.code == 3
    assert swapped.out.startswith("--eye hand is doubtful")
    assert "doubtful" not in swapped.err

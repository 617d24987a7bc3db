"""Logs come back to the last bit or are refused in one line."""

import math
import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import refused
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from reference import random_joints, write_columns
from scipy.spatial.transform import Rotation

import calib
from calib import LogError, OptionError, Samples, babble, load_arm, read_log, train, write_log

GOOD = "a,b,x,y\n0.1,0.2,1,2\n0.2,0.4,3,4\n0.3,0.1,5,6\n"
MODEL = b"9" * 8 + b'{"__metadata__":{"calib":"{}"}}'
TURN = 2 * math.pi
DEGREES = 180 / math.pi
ROWS = st.lists(st.tuples(*[st.floats(-1e12, 1e12)] * 3), min_size=2, unique=True)
BAD = [  # what a file holds, what is asked of it, and what the refusal says
    ("", {}, "is empty"),
    ("1,2,2,3e-1\n2,3,4,5\n", {}, "has no header: expected the columns' names"),
    ("a,b,x,y\n", {}, "has no rows below its header"),
    ("a,b,x,y\n1,2,3,4\n", {}, "one usable row"),
    ("a,b,x\n1,2,3\n", {}, "no column 'y': choose from a, b, x"),
    ("a,b\n0.1,0.2\n0.2,0.4\n", {}, "has no positions: expected columns x, y and z"),
    ("a,bb,x,y\n1,2,3,4\n", {}, "did you mean bb"),
    ("a,b,b,x,y\n1,2,2,3,4\n", {}, "several columns 'b'"),
    ("a,b,x,y\n1,\u0661,3,4\n", {}, "1 of 1 rows miss a finite number .* of b"),
    ("a;b;x;y\n1;0,5;.3;4\n", {}, r"1 of 1 rows miss a finite number \(2.5, not 2,5\) of b"),
    ("a,b,x,y\n1,2,3,4\n0,5,0,6,3,4\n", {}, "row 2 has 6 values, the header 4"),
    ("a,b,x,y\n1,2,,4\n2,3,,5\n", {}, "2 of 2 rows miss a finite number .* of x"),
    ("a,b,x,y\n1,,3,4\n,3,3,5\n", {}, "2 of 2 rows miss a finite number .* of a, b"),
    ("a,b,x,y\n1,2,3,4\n1,3,4,5\n", {}, "a is 1 in every row"),
    ("a,b,x,y\n1,2,3,4\n2,3,3,5\n", {}, "x is 3 in every row"),
    ("a,b,x,y,sensor\n1,2,3,4,l\n2,3,4,5,r\n", {}, "several sensors, l, r: expected a log of one"),
    (b"a,b,x,y,c\n1,2,3,4,\xb0\n", {}, "UTF-8"),
    (b"PAR1 and nothing else", {}, "cannot be read"),
    (b"PK\3\4" + bytes(200), {}, "is a workbook or an archive: .* save it as CSV"),
    (b"\x1f\x8b" + bytes(200), {}, "is compressed: expected a table itself"),
    (MODEL, {}, "is a model, not a log; .log. takes a log .CSV or Parquet."),
    (b"a" * (1 << 20), {}, "no positions"),
    ('a,b,x,y\n1,2,3,"4\n' + "5" * 200_000, {}, "cannot be read"),
    (GOOD, {"joints": None}, "choices: 'a', 'b'; name them in .joints"),
    (GOOD, {"joints": ["b", "b"]}, "taken twice"),
    (GOOD, {"joints": ["b", "x"]}, "taken twice"),
    (GOOD, {"prismatic": ["c"]}, "prismatic. of c: expected some"),
    (GOOD, {"columns": {"q": "a"}}, "'q' is neither"),
    (GOOD, {"columns": {"a": "b"}}, "taken twice"),
]
SPATIAL = load_arm("spatial_three")
HEADERS = [
    ("Time [ms],SHOULDER,Elbow,X,Y", (1, 1, 1), "m", False),
    ("time,shoulder (deg),elbow [deg],x [mm],y (mm)", (DEGREES, DEGREES, 1e3), "mm", True),
    ("time,shoulder [rad],elbow [°],X(cm),Y(cm)", (1, DEGREES, 100), "cm", False),
    ("time,shoulder,elbow,u [px],V [px]", (1, 1, 1), "px", False),
]
CLOCKS = [
    lambda k: f"2024-03-01T12:00:00.{20 * k:03d}Z",
    lambda k: 1709294400000 + 20 * k,
    lambda k: 1709294400000000000 + 20_000_000 * k,
]


def unread(path, words, error=LogError, **options):
    refused(error, words, read_log, path, **({"joints": ["a", "b"]} | options))


@given(ROWS, st.sampled_from([".csv", ".parquet"]))
@settings(max_examples=50)
def test_any_finite_numbers_come_back(tmp_path, rows, suffix):
    values = np.array(rows)
    q, x = values[:, :1], values[:, 1:]
    if (np.ptp(values, axis=0) == 0).any():
        return
    name = 'slide, "the" é肘'
    log = Samples(q, x, (name,), q.min(axis=0), q.max(axis=0), (False,))
    write_log(log, tmp_path / f"log{suffix}")
    again = read_log(tmp_path / f"log{suffix}", joints=[name], prismatic=[name])
    assert (again.q == q).all()
    assert (again.x == x).all()


@pytest.mark.parametrize(("sep", "code"), [(";", "utf-8"), ("\t", "utf-16"), (";", "utf-8-sig")])
def test_tables_of_spreadsheets_have_commas_in_their_decimals(sep, code, file):
    rows = [["a", "b", "x", "y"], ["-0,5", "1", "2,25e-1", ",5"], ["0,5", "3,0", "4", "1,5"]]
    log = read_log(file("\n".join(map(sep.join, rows)).encode(code)), joints=["a", "b"])
    assert log.q.tolist() == [[-0.5, 1.0], [0.5, 3.0]]
    assert log.x.tolist() == [[0.225, 0.5], [4.0, 1.5]]


@pytest.mark.parametrize(
    "text",
    [
        "# May\na,b,x,y\n1,2,3,4",
        "# a b x y\n1 2 3 4",
        "# May\n# a,b,x,y\n1,2,3,4",
        "a b x  y\n1 2 3 4",
    ],
)
def test_tables_of_numpy_have_blanks_and_a_header_behind_a_hash(text, file):
    row = " ".join("2468") if " " in text.splitlines()[-1] else "2,4,6,8"
    assert read_log(file(f"{text}\n{row}\n"), joints=["a", "b"]).x.tolist() == [[3, 4], [6, 8]]


def test_times_that_are_not_used_are_told(file):
    log = read_log(file("a,x,y,time\n1,2,3,0.1\n2,3,3,12:00\n3,5,4,0.3\n"), joints=["a"])
    assert log.time is None
    assert "the column time is not used, it has no number in 1 rows: row 2" in log.notes


@pytest.mark.parametrize(("content", "options", "message"), BAD)
def test_bad_files_are_refused_in_one_line(file, content, options, message):
    unread(file(content), message, OptionError if options else LogError, **options)


def test_files_that_are_none(tmp_path, file, run):
    unread(tmp_path / "no.csv", "No such file")
    unread(tmp_path, "no table.*calib log")
    unread("a\0b", "cannot read")
    unread("/dev/zero", "is a device")
    np.save(tmp_path / "log.npy", np.eye(4))  # the robot was said to be none
    run.refused(1, "no names of columns", "train", "two_link", "--data", tmp_path / "log.npy")
    assert len(read_log(file(GOOD, "log.parquet"), joints=["a", "b"])) == 3  # by its content
    lines = pl.read_csv(file(GOOD)).write_ndjson()
    assert len(read_log(file(lines, "log.jsonl"), joints=["a", "b"])) == 3


def test_columns_are_found_by_name_in_any_order_and_others_are_ignored(arm, file):
    path = file("\ufeffy, x ,note,b,a\r\n2,1, text,0.2,0.1\r\n4,3,,0.4,0.2\r\n")
    log = read_log(path, joints=["a", "b"], unit="px")
    assert log.q.tolist() == [[0.1, 0.2], [0.2, 0.4]]
    assert log.x.tolist() == [[1, 2], [3, 4]]
    assert (log.unit, log.lower.tolist(), log.upper.tolist()) == ("px", [0.1, 0.2], [0.2, 0.4])
    path = file("[j1],b,cam_u,cam_v,x\n1,2,3,4,9\n2,4,6,8,9\n")
    log = read_log(path, joints="a,b", columns={"x": "cam_u", "y": "cam_v", "a": "[j1]"})
    assert log.joint_names == ("a", "b")
    assert log.q.tolist() == [[1, 2], [2, 4]]
    assert log.x.tolist() == [[3, 4], [6, 8]]
    # of an arm its own order holds, and its joints are the log's
    path = file("elbow,shoulder,x,y\n0.5,0.1,1,2\n0.6,0.2,3,4\n")
    assert read_log(path, arm).q.tolist() == [[0.1, 0.5], [0.2, 0.6]]
    assert read_log(path, arm, joints=["elbow", "shoulder"]).joint_names == ("shoulder", "elbow")
    refused(OptionError, "loaded with", read_log, path, arm, joints=["elbow"])


@pytest.mark.parametrize(("header", "factors", "unit", "degrees"), HEADERS)
def test_headers_have_units_in_brackets_and_any_case(arm, file, header, factors, unit, degrees):
    log = babble(arm, 20)
    q = log.q * factors[:2]
    rows = np.column_stack([20 * np.arange(20), q, log.x * factors[2]]).tolist()
    again = read_log(file("\n".join([header, *(",".join(map(repr, row)) for row in rows)])), arm)
    assert_allclose(again.q, log.q, rtol=1e-15)
    assert_allclose(again.x, log.x * factors[2])
    assert (again.unit, again.degrees) == (unit, degrees)
    assert again.time[1] == (0.02 if "ms" in header else 20.0)


def test_a_header_says_that_a_joint_slides_or_contradicts(arm, file):
    table = file("turn [deg],rail [mm],x [mm],y [mm]\n90,100,1,2\n80,250,3,4\n70,180,5,7\n")
    log = read_log(table, joints=["turn", "rail"])
    assert log.revolute == (True, False)
    assert log.q[0].tolist() == [math.pi / 2, 0.1]
    words = "states that its positions are in mm, not in m"
    refused(LogError, words, read_log, table, joints=["turn", "rail"], unit="m")
    mixed = file("a,b,x [mm],y [m]\n1,2,3,4\n2,1,4,3\n")
    refused(LogError, "expected positions in one unit", read_log, mixed, joints=["a", "b"])
    slides = file("shoulder [mm],elbow,x,y\n1,2,3,4\n2,1,4,3\n")
    refused(LogError, "'shoulder .mm.' is in mm, expected rad, deg, ", read_log, slides, arm)


@pytest.mark.parametrize("time", CLOCKS)
def test_times_of_clocks_are_seconds(file, time):
    rows = [f"{time(k)},{k % 5},{k % 7},{k},{k * k}" for k in range(12)]
    table = file("\n".join(["stamp,a,b,x,y", *rows]))
    log = read_log(table, joints=["a", "b"], columns={"time": "stamp"})
    assert_allclose(log.time, 1709294400 + 0.02 * np.arange(12), rtol=0, atol=1e-6)


def test_a_sensor_that_holds_its_last_value_is_told_and_one_of_whole_pixels_is_not(arm, tmp_path):
    time = np.arange(300) / 50
    q = np.column_stack([0.8 + 0.7 * np.sin(time), 1.2 + np.cos(1.7 * time)])
    x = arm.forward(q) + np.random.default_rng(0).normal(0, 1e-4, (300, 2))
    x[100:112] = x[99]
    write_log(Samples(q, x, arm.joint_names), tmp_path / "held.csv")
    log = read_log(tmp_path / "held.csv", arm)
    assert (len(log), log.left_out) == (288, 12)
    assert "12 of 300 rows repeat the position of the row before" in log.notes[0]
    assert "rows 101, 102, 103" in log.notes[0]
    pixels = Samples(q, np.round(200 * arm.forward(q)), arm.joint_names, unit="px")
    write_log(pixels, tmp_path / "px.csv")
    again = read_log(tmp_path / "px.csv", joints=arm.joint_names, unit="px")
    assert (len(again), again.left_out) == (300, 0)
    resting = Samples(q, x, arm.joint_names).take(np.repeat(np.arange(120, 300, 10), 5))
    write_log(resting, tmp_path / "rest.csv")
    assert read_log(tmp_path / "rest.csv", arm).left_out == 0


@pytest.mark.parametrize(
    ("case", "left_out"),
    [("every third", 200), ("sensor stuck", 209), ("at rest", 0), ("coarse encoders", 0)],
)
def test_joints_that_are_read_less_often_than_positions_are_told(arm, tmp_path, case, left_out):
    """Bounds were 20 to 150 mm of .1 to .5 mm, and all was still calibrated."""
    time = np.arange(300) / 30
    q = np.column_stack([0.8 + 0.7 * np.sin(time), 1.2 + np.cos(1.7 * time)])
    x = arm.forward(q) + np.random.default_rng(0).normal(0, 1e-4, (300, 2))
    q = np.round(q / 0.05) * 0.05 if case == "coarse encoders" else q[np.arange(300) // 3 * 3]
    if case == "at rest":
        # positions that scatter as far as they move
        x = arm.forward(q) + np.random.default_rng(0).normal(0, 2e-2, (300, 2))
    if case == "sensor stuck":
        x[99:130] = x[99]
    write_log(Samples(q, x, arm.joint_names), tmp_path / "log.csv")
    log = read_log(tmp_path / "log.csv", arm)
    assert log.left_out == left_out
    told = "repeat the joints of the row before although the positions moved on" in str(log.notes)
    assert told == (left_out > 0)


def test_rows_without_a_finite_value_are_left_out_and_counted(arm, file):
    rows = "1,2,3,4,\n2,,3,4,\n3,4,nan,5,\n4,5,1e999,2,\n\n5,6,NA,2,\n5,6,1e300,2,\n7,8,1,9,\n\n"
    log = read_log(file("a,b,x,y,t\n" + rows), joints=["a", "b"])
    assert log.q.tolist() == [[1, 2], [7, 8]]
    assert log.dropped == 6  # a line in which nothing stands too
    assert log.notes[0].startswith("6 of 8 rows miss a finite number")
    assert log.rows.tolist() == [1, 8]
    rows = "shoulder,elbow,x,y\n,0.5,1,2\n1,1,2,3\n1.1,3,3,4\n"
    unread(file(rows), "row 3: elbow", arm=arm, joints=None)


def test_parquet_of_other_types(tmp_path):
    path = tmp_path / "log.parquet"
    columns = {"a": [1, 2, None], "b": ["0.5", " 1 ", "2"], "x": [1, 3, 2], "y": [1.5, 2, 3]}
    frame = pl.DataFrame(columns)
    frame.write_parquet(path)
    log = read_log(path, joints=["a", "b"])
    assert log.q.tolist() == [[1, 0.5], [2, 1]]
    assert log.dropped == 1
    frame.with_columns(b=pl.Series([True, False, True])).write_parquet(path)
    unread(path, "column 'b' holds Boolean, expected")
    frame.with_columns(b=pl.Series(["1", "two", "3"])).write_parquet(path)
    unread(path, "one usable row")


def test_locked_joints_are_the_medians_of_their_columns(tmp_path, run):
    three = load_arm("three_link")
    q = babble(three, 200).q
    path, out = tmp_path / "log.csv", tmp_path / "m.calib"
    command = f"train three_link --joints shoulder,elbow --tip tip --data {path} --size 3 -o {out}"
    words = command.split()

    def trained(wrist, *more, factor=1.0):
        x = three.forward(np.column_stack([q[:, :2], wrist]))
        columns = np.column_stack([factor * q[:, :2], factor * wrist, x]).T
        write_columns(path, dict(zip(["shoulder", "elbow", "w", "x", "y"], columns, strict=True)))
        return run(*words, "--columns", "wrist=w", *more)

    wrist = np.full(200, 0.25)
    wrist[7] = 0.6  # a wrong reading
    for more, factor in (((), 1.0), (("--degrees",), DEGREES)):
        done = trained(wrist, *more, factor=factor)
        assert "wrist is locked but moved by up to 20.1 deg" in done.err + done.out
        assert calib.load(out).about.locked["wrist"] == pytest.approx(0.25)
    wrist[50:90] += np.linspace(0.0, 0.5, 40)
    assert trained(wrist).code == 1
    assert re.search("wrist is locked but moved.*row 90", trained(wrist).err)
    run.refused(1, "no column 'ww': did you mean w", *words, "--columns", "wrist=ww")


def test_what_is_known_of_the_clock_is_taken_and_nothing_estimated(arm, tmp_path):
    time = np.arange(400) * 0.02

    def q(t):
        return np.stack([0.8 + 0.7 * np.sin(t), 1.4 + np.cos(1.3 * t)], axis=1)

    then, path = q(time - 0.03), tmp_path / "late.csv"
    x = arm.forward(then)
    write_log(Samples(q(time), x, arm.joint_names, time=time), path)
    log = read_log(path, arm, time_offset=-0.03)
    assert np.abs(arm.forward(log.q) - log.x)[5:-5].max() < 1e-5  # cubic but for both ends
    assert "-0.03 s added" in " ".join(log.notes)
    models = (train(read_log(path, arm, time_offset=offset), size=5) for offset in (None, 0.0))
    estimated, believed = (np.linalg.norm(m.forward(then) - x, axis=1).mean() for m in models)
    assert estimated < 1e-4 < 1e-3 < believed
    refused(LogError, "no row's joints", read_log, path, arm, time_offset=60.0)
    write_log(replace(log, time=None), tmp_path / "no_times.csv")
    refused(LogError, "column `time`", read_log, tmp_path / "no_times.csv", arm, time_offset=0.1)


def test_degrees_are_read_as_radians_and_counts_of_an_encoder_are_neither(arm, file):
    counts = file("shoulder,elbow,x,y\n3072,100,.1,.2\n2050,2000,.2,.3\n")
    for degrees in (False, True):
        refused(LogError, "an encoder's counts to rad", read_log, counts, arm, degrees=degrees)
    q = np.deg2rad([[10, 20], [80, 140], [90, 150], [0, 15]])
    path = file("shoulder,elbow,x,y\n10,20,1,2\n80,140,2,3\n90,150,2,5\n0,15,6,6\n")
    log = read_log(path, arm, degrees=True)
    assert_allclose(log.q, q, atol=1e-15)
    assert log.notes == ()
    assert_allclose([log.lower, log.upper], [arm.lower, arm.upper], atol=1e-12)
    unread(path, "give `degrees=True`", arm=arm, joints=None)
    unread(path, "90 rad.*3.14.*degrees=True", joints=["shoulder"])
    turned = file("shoulder,elbow,x,y\n0.1,7.85,1,2\n0.2,1.2,2,3\n0.3,2.0,2,5\n")  # no degrees
    assert read_log(turned, arm).notes == ("elbow: 1 values wrapped by whole turns",)
    log = read_log(file(GOOD), joints="a,b", degrees=True, prismatic=["b"])
    assert_allclose(log.q[:, 0], np.deg2rad([0.1, 0.2, 0.3]))
    assert log.q[:, 1].tolist() == [0.2, 0.4, 0.1]  # a sliding joint's are metres
    assert log.revolute == (True, False)


def test_a_chosen_range_goes_before_the_limits(arm, file):
    path = file("shoulder,elbow,x,y\n0.1,0.5,1,2\n0.2,1,2,3\n0.3,3,3,4\n0.4,7,3,5\n")
    log = read_log(path, arm, ranges={"elbow": (0.6, 3.1)})
    assert_allclose(log.q[:, 1], [1, 3, 7 - TURN])
    assert log.q[:, 0].tolist() == [0.2, 0.3, 0.4]
    assert (log.lower[1], log.upper[1]) == (0.6, 3.1)
    assert any("1 of 4 rows have elbow outside" in note for note in log.notes)
    for bad in ((1.0, 0.6), (0.0, 9.0), (0.0, math.nan)):
        unread(path, "range elbow", OptionError, arm=arm, joints=None, ranges={"elbow": bad})
    every = "4 of 4 rows have elbow outside"
    unread(path, every, arm=arm, joints=None, ranges={"elbow": (4, 5)})


def test_more_than_one_turn_becomes_one(file):
    a = np.linspace(-4.0, 4.0, 400)
    columns = {"a": a, "b": np.cos(a), "x": a, "y": a**2}
    log = read_log(file(pl.DataFrame(columns).write_csv()), joints=["a", "b"])
    assert (log.lower[0], log.upper[0]) == (-math.pi, math.pi)
    assert_allclose(np.exp(1j * log.q[:, 0]), np.exp(1j * a), atol=1e-12)
    assert "wrapped" in log.notes[0]
    assert (log.q[:, 0] == a)[np.abs(a) <= math.pi].all()


@pytest.fixture
def posed(tmp_path):
    """What writes a log of an arm in space and returns its path; positions and orientations."""
    q = random_joints(SPATIAL, 40)
    x, turns = SPATIAL.pose(q)

    def write(positions=x, **more):
        names = (*SPATIAL.joint_names, *"xyz")
        columns = dict(zip(names, np.hstack([q, positions]).T, strict=True))
        write_columns(tmp_path / "log.csv", columns | more)
        return tmp_path / "log.csv"

    return write, x, turns


def quaternion(turns):
    return dict(zip(("qx", "qy", "qz", "qw"), turns.T, strict=True))


def test_positions_and_orientations_are_read_and_written(posed, tmp_path):
    write, x, turns = posed
    log = read_log(write(**quaternion(-turns)), SPATIAL)  # the same orientations
    assert_array_equal(log.x, x)
    assert_allclose(log.orientation, turns, atol=1e-15)
    assert log.plane is None
    write_log(log, tmp_path / "b.csv")
    again = read_log(tmp_path / "b.csv", SPATIAL)
    assert_array_equal(again.x, log.x)
    assert_allclose(again.orientation, log.orientation, atol=1e-15)
    assert again.take([3, 5]).orientation.shape == (2, 4)
    angles = np.random.default_rng(1).uniform(-1, 1, (40, 3))
    more = dict(zip(("roll", "pitch", "yaw"), angles.T, strict=True))  # as in a URDF
    rotation = Rotation.from_quat(read_log(write(**more), SPATIAL).orientation)
    expected = Rotation.from_euler("xyz", angles).as_matrix()
    assert_allclose(rotation.as_matrix(), expected, atol=1e-12)
    turned = {name: np.degrees(values) for name, values in more.items()}
    unread(write(**turned), "give `degrees=True`", arm=SPATIAL, joints=None)


def test_quaternions_that_are_none_are_told_in_one_line(posed):
    write, _, turns = posed
    turns[7:30] = (0.5, 0.5, 0.0, 0.0)
    log = read_log(write(**quaternion(turns)), SPATIAL)
    assert len(log) == log.left_out - 6 == 17
    assert "length 0.7071, expected 1; left out: rows 8, 9" in log.notes[0]


def test_without_an_arm_positions_in_a_plane_are_planar_unless_an_arm_is_in_space(posed):
    write, x, _ = posed
    names = SPATIAL.joint_names
    assert read_log(write(), joints=names).x.shape == (40, 3)
    path = write(x * (1, 1, 1e-4))
    log = read_log(path, joints=names)
    assert log.x.shape == (40, 2)
    assert log.plane is not None
    assert_allclose(read_log(path, joints=names, outputs=3).x, x * (1, 1, 1e-4))
    path.write_text(path.read_text().replace("x,y,z", "x,y,height"))
    refused(LogError, "two coordinates", read_log, path, joints=names, outputs=3)


def test_of_a_very_long_log_evenly_spread_rows_are_held(tmp_path, arm):
    q = random_joints(arm, 400_000)
    columns = dict(zip([*arm.joint_names, *"xy"], np.hstack([q, arm.forward(q)]).T, strict=True))
    pl.DataFrame(columns).write_parquet(tmp_path / "long.parquet")
    log = read_log(tmp_path / "long.parquet", arm)
    assert len(log) == 200_000
    assert set(np.diff(log.rows)) <= {2, 3}
    assert (log.q == q[log.rows - 1]).all()
    assert "400,000 rows: 200,000 of them, evenly spread" in log.notes[0]

"""Several sensors of one arm: files or a column, repeated poses, one model, its own answers."""

import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import refused
from models import built, draw, lengths, log_of, seen_by_two, seen_from
from scenes import data_of, objects, page_of

import calib

NOISE = 1e-4  # [m]


@pytest.fixture(scope="module")
def logs():
    return [seen_from("left", 40, 1, 0.0), seen_from("right", 60, 2, 0.5)]


@pytest.fixture(scope="module")
def two():
    return seen_by_two()


def test_files_and_a_column_make_the_same_model_of_two_sensors(logs, run, tmp_path):
    files, tables = [], []
    for log, _ in logs:
        path = tmp_path / f"{log.sensor}.csv"
        calib.write_log(log, path)
        files += ["--data", path]
        tables.append(pl.read_csv(path).with_columns(sensor=pl.lit(log.sensor)))
    both = tmp_path / "both.csv"
    pl.concat(tables).write_csv(both)
    train = ("train", "spatial_three", "--size", "3", "--json")
    done = run.done(*train, *files, "-o", tmp_path / "two.calib")
    sensors = [(each["name"], each["rows"]) for each in done.document["sensors"]]
    assert sensors == [("left", 40), ("right", 60)]
    one = run.done(*train[:-1], "--data", both, "-o", tmp_path / "one.calib")
    assert ", 100 rows, " in one.out
    told = run("info", tmp_path / "one.calib").out
    assert re.search("100 rows of 2 logs, (.*\n)+.*left .40 rows., right .60 rows.", told)
    assert (tmp_path / "two.calib").read_bytes() == (tmp_path / "one.calib").read_bytes()
    words = ("evaluate", tmp_path / "two.calib", "--data", tmp_path / "right.csv", "--json")
    assert run(*words).document["learned"] == 60
    calib.write_log(seen_from("right", 30, 3, 0.5)[0], tmp_path / "right.csv")
    document = run(*words).document
    assert document["learned"] == 0
    assert document["bound_holds"]


def test_a_second_sensor_helps_the_first_and_both_bounds_hold(logs, two):
    alone = calib.train(logs[0][0], size=3)
    q = np.random.default_rng(9).uniform(alone.about.lower, alone.about.upper, (300, 3))

    def miss(model, truth):
        return lengths(model.forward(q) - truth(q))

    assert miss(two, logs[0][1]).mean() < 0.9 * miss(alone, logs[0][1]).mean()
    for log, truth in logs:
        seen = two.by(log.sensor)
        assert np.mean(miss(seen, truth) <= seen.model_error(q)) > 0.9


def test_sensors_whose_scales_or_arms_disagree_are_told_and_leave_the_first_as_good(logs, two):
    """A second tracker that read lengths .3 % longer made errors of .05 mm .4, all drifted."""
    (left, truth), (right, _) = logs
    model = calib.train([left, replace(right, x=1.003 * right.x)], size=3)
    assert any(note.startswith("right: lengths that it reads are +0.3") for note in model.notes)
    q = draw(model, 300)
    assert lengths(model.forward(q) - truth(q)).mean() < 1e-4
    fresh, _ = seen_from("left", 40, 7, 0.0)
    assert not calib.check(model, fresh).drifted
    # one of another arm is named
    moved = replace(right, q=right.q + np.array([0.0, 0.05, 0.0]))
    notes = calib.train([left, moved], size=3).notes
    assert any("right: it disagrees with the other sensors" in note for note in notes)
    assert not any("disagrees" in note for note in two.notes)


def test_what_only_the_second_sensor_shows_of_the_arm_is_learned(logs):
    """The rows of a coarse first one alone chose what is fitted: no elasticity, and "drifted"."""
    left, (right, _) = logs[0][0], seen_from("right", 80, 2, 0.5)
    rough = np.random.default_rng(5).normal(0.0, 5e-3, left.x.shape)
    model = calib.train([replace(left, x=left.x + rough), right], size=3)
    assert not calib.check(model, seen_from("right", 40, 7, 0.5)[0]).drifted


def test_a_few_precise_rows_beside_many_coarse_ones_do_not_hide_their_noise():
    """Parameters that followed them were shared by all rows: .51 and .66 of the noise."""
    noises = []
    for seed in (10, 11):
        left, (right, _) = seen_from("left", 15, seed, 0.0)[0], seen_from("right", 200, 20, 0.5)
        rough = np.random.default_rng(seed).normal(0.0, 2e-3, right.x.shape)
        model = calib.train([left, replace(right, x=right.x + rough)], size=3)
        noises.append(model.body.noise[0] / NOISE)
    assert 0.7 < np.mean(noises) < 1.3


def test_the_play_of_a_joint_is_as_its_best_sensor_shows_it():
    """The mean of two sensors' was .46 and .26 of a degree where the truth is .26."""
    arm, structure, beta, rng = built()
    play, logs = np.array([0.0, 3e-3, 0.0]), []
    for name, noise in (("coarse", 2e-3), ("fine", 5e-5)):
        q = rng.uniform(arm.lower, arm.upper, (120, 3))
        side = np.sign(np.diff(q, axis=0, prepend=q[:1]))
        x = structure.predict(q - play * side, beta) + rng.normal(0.0, noise, q.shape)
        logs.append(log_of(arm, q, x, sensor=name))
    model = calib.train(logs, size=3)
    assert model.approach.play == pytest.approx(play, abs=1e-4)
    (note,) = (note for note in model.notes if "backlash" in note)
    assert "shoulder_lift 0.34" in note


def test_two_sensors_see_a_planar_arm_from_both_sides_in_units_of_their_own(run, tmp_path):
    arm, rng, rows = calib.load_arm("two_link"), np.random.default_rng(0), []
    sides = (("front", "m", np.ones(2)), ("back", "mm", np.array([1e3, -1e3])))
    train = ["train", "two_link", "--size", "3"]
    for name, unit, axes in sides:
        q = rng.uniform(arm.lower, arm.upper, (40, 2))
        z = axes * (arm.forward(q) + 0.1 + rng.normal(0.0, NOISE / 2, (40, 2)))
        rows.append(log_of(arm, q, z, sensor=name, unit=unit))
        table = pl.DataFrame(np.hstack([q, z]), (*arm.joint_names, *"xy"))
        table.write_csv(tmp_path / f"{name}.csv")
        train += ["--data", tmp_path / f"{name}.csv"]
    run.refused(1, "or name the columns 'x [mm]'", *train)  # no `--unit` is right for both
    table.rename({"x": "x [mm]", "y": "y [mm]"}).write_csv(tmp_path / "back.csv")
    run.done(*train, "-o", tmp_path / "both.calib")
    both, fresh = calib.train(rows, size=3), rng.uniform(arm.lower, arm.upper, (100, 2))
    for name, _, axes in sides:
        missed = both.by(name).forward(fresh) / axes - arm.forward(fresh) - 0.1
        assert lengths(missed).max() < 1e-4
    drawn = objects(data_of(page_of(both)))
    # mm were taken for m: all rows had the colour of the largest errors
    assert len(np.unique(drawn["Rows back/positions"]["tints"], axis=0)) > 10
    both.save(tmp_path / "both.calib")
    calib.write_log(replace(rows[1], x=np.add(rows[1].x, (5.0, 0.0))), tmp_path / "back.csv")
    words = (tmp_path / "both.calib", "--data", tmp_path / "back.csv", "--json")
    document = run.done("adapt", *words).document
    assert document["unit"] == run("recognise", *words).document["unit"] == "mm"
    assert 4.0 < document["before"]["mean"] < 6.0
    front = calib.load(document["model"])
    (event,), (of_back,) = front.history, front.by("back").history
    assert of_back["frame"] is not None
    assert {"frame", "before", "after"}.isdisjoint(event)


def test_logs_of_several_sensors_that_are_not_of_one_arm_are_refused(logs):
    log = logs[0][0]
    refused(calib.LogError, "a name of its own", calib.train, [log, log])
    other = calib.babble(calib.load_arm("two_link"), 50)
    refused(calib.LogError, "simulation", calib.train, [log, other])
    plane = replace(other, simulation=None, sensor="plane")
    refused(calib.CalibError, "a log of the same arm", calib.train, [log, plane])


def test_poses_that_are_read_again_are_no_new_poses(logs):
    log, _ = logs[0]
    few = log.take(np.tile(np.arange(8), 20))
    refused(calib.LogError, "poses: 8, in 160 rows: too few", calib.train, few)
    twice = calib.train(log.take(np.tile(np.arange(40), 2)), size=3)
    assert twice.about.errors == calib.train(log, size=3).about.errors
    assert twice.about.samples == 40
    notes = calib.train([log, replace(log, sensor="again")], size=3).notes
    assert any("again: 40 of its 40 rows are those of left" in note for note in notes)


def test_a_sensor_is_asked_by_its_name(two, run, tmp_path):
    path, q = tmp_path / "two.calib", [0.3, 0.6, -0.9]
    two.save(path)

    def position(*frame):
        return run.done("query", "forward", path, *q, *frame, "--json").document["position"]

    assert position() == position("--in", "left") == two.forward(q).tolist()
    target = position("--in", "right")
    assert target == two.by("right").forward(q).tolist()
    assert len(position("--in", "base")) == 3
    words = ("--near", "0.3,0.6,-0.9", "--in", "right", "--json")
    back = run("query", "inverse", path, *target, *words)
    np.testing.assert_allclose([*back.document["solutions"][0]["joints"].values()], q, atol=1e-6)
    follow = ("query", "path", path, "--input", tmp_path / "way.csv", "--from", "0.3,0.6,-0.9")
    for sensor in ("right", "base"):
        lines = [",".join(map(str, position("--in", sensor)))] * 2
        (tmp_path / "way.csv").write_text("\n".join(["x,y,z", *lines]))
        way = run(*follow, "--in", sensor, "--json").document
        assert way.get("sensor", "base") == sensor
        np.testing.assert_allclose(way["path"]["shoulder_pan"], q[0], atol=1e-6)
    assert "left, right" in run("query", "forward", path, *q, "--in", "top").err
    told = run("evaluate", path, "--in", "right", "--json").document
    assert told["errors"] == two.by("right").about.errors
    for command in ("info", "evaluate"):
        assert {"left: ", "right: "} <= set(re.findall("left: |right: ", run(command, path).out))
    run("export", path, "-o", tmp_path / "first.h")
    run("export", path, "-o", tmp_path / "right.h", "--in", "right")
    assert (tmp_path / "first.h").read_bytes() != (tmp_path / "right.h").read_bytes()
    nameless = replace(two, others=(), about=replace(two.about, sensor=""))
    refused(calib.OptionError, "'base': expected none", nameless.forward, q, sensor="base")


def test_a_log_that_names_no_sensor_of_the_model_is_not_taken_for_the_first(two, run, tmp_path):
    """It was: a fresh log of the second one had drifted by 80 deg, and was adapted to."""
    path, new = tmp_path / "two.calib", tmp_path / "new.csv"
    two.save(path)
    calib.write_log(seen_from("right", 40, 7, 0.5)[0], new)
    for command in ("check", "adapt", "recognise", "evaluate", f"report -o {tmp_path}/page.html"):
        words = [*command.split(), path, "--data", new]
        run.refused(1, "of the model's, left, right; say --in SENSOR", *words)
        assert run(*words, "--in", "right").code == (3 if command == "adapt" else 0)
        run.refused(2, "'top': expected left, right", *words, "--in", "top")
    check = ("check", path, "--data", new)
    assert "--in left re-calibrates it" in run(*check, "--in", "left").out
    for names in (["other"], ["other", "right"], ["right"]):
        table = pl.read_csv(new, comment_prefix="#")
        table.with_columns(sensor=np.resize(names, 40)).write_csv(new)
        if names != ["right"]:
            run.refused(1, f"names {', '.join(names)}: expected one of the model's", *check)
        assert run.done(*check, "--in", "right", "--json").document["samples"] >= 20
    run.done(*check)
    assert calib.read_log(new, joints=two.about.joint_names).sensor == "right"
    run.refused(2, "--in left: the column", *check, "--in", "left")


def test_a_log_is_judged_as_its_sensor_sees_the_arm(two):
    q = draw(two, 40, seed=3)
    x = two.by("right").forward(q) + np.random.default_rng(3).normal(0.0, 2e-5, q.shape)
    log = calib.Samples(q, x, two.about.joint_names, sensor="right")
    assert not calib.check(two, log).drifted
    assert calib.check(two, replace(log, sensor="left")).drifted
    turned = replace(log, q=log.q - np.array([0.0, 0.01, 0.0]))  # the shoulder was put on anew
    adapted = calib.adapt(two, turned)
    assert adapted.improved, adapted.notes
    assert adapted.model.sensors == ("left", "right")
    moved = adapted.model.forward(turned.q, sensor="right") - two.by("right").forward(q)
    assert np.median(lengths(moved)) < 3e-4
    # a bound alone that became wider has no event for the others to take over
    right = replace(two.by("right"), bounds=2.0 * two.by("right").bounds)
    wider = two.with_sensor(right)
    assert not wider.history
    assert np.array_equal(wider.by("right").bounds, right.bounds)

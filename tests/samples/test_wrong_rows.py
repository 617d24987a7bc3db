"""Wrong rows of a log are left out and told; rows that agree with their neighbours never are."""

from dataclasses import replace

import numpy as np
import pytest
from models import bare

import calib
from calib.samples.tables import write_table


def screen(log):
    """How many rows training leaves out, and what it says of them."""
    about = calib.train(log, size=4).about
    return about.left_out, [note for note in about.notes if "left out" in note]


def spoiled(log, share, size=0.05, seed=7):
    """The log with a share of its rows moved by `size` [m] in random directions."""
    rng = np.random.default_rng(seed)
    wrong = rng.random(len(log)) < share
    angle = rng.uniform(0, 2 * np.pi, len(log))
    step = size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return replace(log, x=log.x + wrong[:, None] * step), wrong


@pytest.mark.parametrize("robot", ["two_link_full", "three_link"])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("n", [20, 140, 400])
def test_clean_logs_lose_no_row(robot, noise, n):
    for seed in (1, 2):
        assert screen(bare(robot, n, seed, noise=noise)) == (0, [])


@pytest.mark.parametrize("n", [300, 2000])
@pytest.mark.parametrize("share", [0.01, 0.05, 0.15])
def test_rows_wrong_by_centimetres_are_found_and_no_others(n, share):
    log, wrong = spoiled(bare("two_link", n, 1, noise=1e-3), share)
    count, notes = screen(log)
    assert count == wrong.sum()
    assert f"{wrong.sum():,} of {n:,} rows" in notes[0]
    first = np.flatnonzero(wrong)[:3] + 1
    assert all(str(row) in notes[0] for row in first)


def test_a_patch_that_bends_away_is_no_outlier():
    """No smooth function of few terms follows a bump, but neighbours share it."""
    log = bare("two_link", 3000, 1, noise=1e-3)
    u = (log.q - log.lower) / (log.upper - log.lower)
    bump = 0.05 * np.exp(-0.5 * np.sum((u - 0.5) ** 2, axis=1) / 0.05**2)
    assert screen(replace(log, x=log.x + bump[:, None]))[0] <= 3


def test_a_row_far_from_all_others_is_no_outlier():
    """What a fit to the other rows says there is a guess."""
    log = bare("two_link", 1000, 1, noise=1e-3)
    near = (log.q < np.quantile(log.q, 0.5, axis=0)).all(axis=1)
    alone = int(np.argmax(log.q.sum(axis=1)))
    rows = np.append(np.flatnonzero(near), alone)
    x = log.x.copy()
    x[alone] += 0.03
    assert screen(replace(log, x=x).take(rows))[0] == 0


def in_space(n=120, seed=2):
    arm = calib.load_arm("spatial_three")
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (n, 3))
    place, turns = arm.pose(q)
    place += rng.normal(0.0, 1e-4, place.shape)
    table = dict(zip((*arm.joint_names, *"xyz"), np.hstack([q, place]).T, strict=True))
    return arm, table, dict(zip(("qx", "qy", "qz", "qw"), turns.T, strict=True))


@pytest.mark.parametrize("lost", [[17], [3, 17, 40, 41, 99]])
def test_rows_of_zeros_in_space_are_left_out_of_learning_and_of_errors(tmp_path, lost):
    """122 of them were neither dropped nor counted, and the table said 54 mm for .01."""
    arm, table, _ = in_space()
    clean = calib.train(_read(tmp_path, table, arm), size=6)
    for axis in "xyz":
        table[axis][lost] = 0.0
    log = _read(tmp_path, table, arm)
    model = calib.train(log, size=6)
    assert model.about.left_out == len(lost)
    assert model.about.samples == 120 - len(lost)
    told = [note for note in (*log.notes, *model.about.notes) if "left out" in note]
    assert f"row {lost[0] + 1}" in told[0] or f"rows {lost[0] + 1}, " in told[0]
    errors = [m.about.errors["local"]["forward"]["distance"]["max"] for m in (model, clean)]
    assert errors[0] < 1.5 * errors[1]
    evaluated = calib.evaluate(clean, log)
    assert evaluated.left_out >= len(lost)
    assert evaluated.errors["local"]["forward"]["distance"]["max"] < 2e-3


def _read(tmp_path, table, arm):
    write_table(tmp_path / "log.csv", table)
    return calib.read_log(tmp_path / "log.csv", arm)

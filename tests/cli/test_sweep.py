"""Sweeps: every combination is trained, failures are rows, numbers do not depend on where."""

import csv
import math

import numpy as np
import pytest

import calib
from calib import OptionError

GRID = {"size": [5, (6, 7)], "samples": [300]}


@pytest.fixture(scope="module")
def found():
    return calib.sweep("two_link", GRID, seeds=2, jobs=1)


def test_every_combination_is_trained_with_every_seed_in_order(found):
    assert [(row.options["size"], row.seed) for row in found.rows] == [
        (5, 0), (5, 1), ((6, 7), 0), ((6, 7), 1),
    ]  # fmt: skip
    assert not found.failed


def test_a_row_is_what_training_alone_gives(found):
    model = calib.train(calib.babble(calib.load_arm("two_link"), 300, seed=1), size=5, seed=1)
    assert found.rows[1].errors == model.about.errors


def test_numbers_are_the_same_whatever_runs_them(found):
    joblib = pytest.importorskip("joblib")
    with joblib.parallel_config("threading", n_jobs=2):
        again = calib.sweep("two_link", GRID, seeds=2)
    assert [row.errors for row in again.rows] == [row.errors for row in found.rows]


def test_what_fails_is_a_row_and_the_others_go_on():
    told = calib.sweep(["two_link", "no_such_arm"], {"size": [5], "samples": [300]}, jobs=1)
    assert [bool(row.error) for row in told.rows] == [False, True]
    assert "no_such_arm" in told.rows[1].error
    assert math.isnan(told.rows[1].distance("local", "forward", "mean"))


@pytest.mark.parametrize(
    ("sources", "grid", "said"),
    [
        ([], {}, "0 trainings"),
        ("two_link", {"sizes": [5]}, "size"),
        ("two_link", {"size": []}, "0 trainings"),
        ("two_link", {"map": "som"}, "list"),
        ("two_link", {"size": range(2, 300), "epochs": range(1, 99)}, "10,000"),
    ],
)
def test_what_is_no_grid_is_refused_before_the_work(sources, grid, said):
    with pytest.raises(OptionError, match=said):
        calib.sweep(sources, grid, jobs=1)


def test_the_command_writes_a_row_for_each_training(run, tmp_path):
    line = "sweep two_link --size 5,6x7 --map som,gas -n 300 --jobs 1 -o"
    done = run(*line.split(), str(tmp_path / "s.csv"))
    assert done.code == 0
    with (tmp_path / "s.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(r["size"], r["map"]) for r in rows] == [
        ("5", "som"), ("5", "gas"), ("6x7", "som"), ("6x7", "gas"),
    ]  # fmt: skip
    assert all(np.isfinite(float(r["local_forward_mean"])) for r in rows)
    assert "local readout" in done.out

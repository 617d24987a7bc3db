"""The paper's experiments: what they hold, and a small run of the command line."""

import csv

import numpy as np
import pytest

import calib
from calib.paper.trial import SeedErrors, Setting, activity_errors, row_of_seeds


def test_rows_of_several_seeds_are_their_mean_and_spread():
    def result(value):
        cell = {"mean": value, "max": 2 * value, "p99": value}
        sides = {"forward": {"x": cell, "distance": cell}, "inverse": {"elbow": cell}}
        return SeedErrors({"activity": sides}, {"x": 2.0, "elbow": 4.0})

    row = row_of_seeds([result(1.0), result(5.0)])["activity"]
    assert row["x"]["mean"] == 3.0
    assert row["x"]["mean_spread"] == 2.0
    assert row["x"]["max"] == 6.0
    assert row["x"]["mean_of_range"] == 1.5
    assert row["elbow"]["max_of_range"] == 1.5
    assert row["forward_distance"]["mean"] == 3.0


def test_schedules_are_chosen_on_points_that_no_table_sees():
    setting = Setting.of(quick=True)
    samples = setting.babble(0)
    q, x = setting.validation(samples, 0)
    np.testing.assert_array_equal(x, samples.simulation.exact(q))
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(4,)))
    tested = samples.simulation.draw(10_000, rng)
    assert not np.isin(q[:, 0], tested[:, 0]).any()
    assert not np.isin(q[:, 0], samples.q[:, 0]).any()


def test_the_same_schedule_gives_the_paper_its_ratio():
    """At a last radius of 2 nodes the varying density is far ahead, as in Table 1."""
    log = calib.babble(calib.load_arm("two_link"), 3000, seed=0)
    asked = Setting.of(quick=True).validation(log, 0)
    networks = (calib.SOM(16, name, epochs=12, sigma=(10.0, 2.0)) for name in ("som", "vdsom"))
    pairs = (network.fit_pair(log.q, log.x) for network in networks)
    som, vdsom = (activity_errors(pair, *asked) for pair in pairs)  # of x, y and both joints
    assert (vdsom.mean(axis=0) < np.multiply([0.6, 0.6, 0.8, 0.8], som.mean(axis=0))).all()
    assert (vdsom.max(axis=0)[:2] < 0.7 * som.max(axis=0)[:2]).all()


def test_a_quick_run_writes_tables_and_one_json_document(run, tmp_path):
    done = run.done("reproduce", "table2", "--quick", "--json", "-o", tmp_path)
    table = done.document["table2"]
    assert set(table) >= {"8x8", "12x12", "paper"}
    cell = table["12x12"]["activity"]["x"]
    assert set(cell) >= {"mean", "max", "p99", "mean_spread", "mean_of_range"}
    assert set(table["12x12"]) == {"winner", "activity", "linear"}
    printed = table["paper"]["30x30"]["shoulder"]
    assert np.degrees([printed["mean"], printed["max"]]) == pytest.approx([0.91, 4.6])
    with (tmp_path / "table2.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 3 * 4
    row = next(r for r in rows if r["network"] == "VDSOM 12x12" and r["readout"] == "activity")
    assert float(row["mean"]) == pytest.approx(1e3 * cell["mean"])


def test_figures_and_curves_of_the_adaptation_are_drawn(run, tmp_path):
    done = run.done("reproduce", "adaptation", "--quick", "--json", "-o", tmp_path)
    for name in ("lengthened", "shortened"):
        found = done.document["adaptation"][name]
        errors, distortion = found["errors"]["activity"], found["distortion"]
        assert errors["adapted"]["mean"] < 0.6 * errors["changed"]["mean"]
        assert distortion["adapted"] < distortion["changed"]
    for picture in ("changed.png", "adaptation.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")

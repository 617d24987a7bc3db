"""Sweeps: every combination once, the same numbers wherever they run, failures kept apart."""

from __future__ import annotations

import csv
import importlib.util
import itertools
import math
import os
import signal
import statistics
import subprocess
import sys
import time

import polars as pl
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import calib
from calib.errors import OptionError
from calib.sweeps import backends
from calib.sweeps.trials import Trial, written

GRID = {"size": [4, 5], "samples": [200]}
LINE = ("sweep", "two_link", "--size", "4,5", "-n", "200")


@pytest.fixture(scope="module")
def found():
    """A sweep in this process."""
    return calib.sweep("two_link", GRID, seeds=2, jobs=1)


@pytest.fixture
def no_joblib(monkeypatch):
    real = importlib.util.find_spec
    monkeypatch.setattr(
        backends, "find_spec", lambda name: None if name == "joblib" else real(name)
    )
    monkeypatch.setitem(sys.modules, "joblib", None)  # importing it fails


@pytest.fixture
def asked(monkeypatch, found):
    """What the command asks for; it is given the sweep that there is."""
    calls = []

    def answer(sources, grid, **options):
        calls.append((list(sources), grid, options))
        return found

    monkeypatch.setattr("calib.sweeps.sweep.sweep", answer)
    return calls


def numbers(sweep):
    return [(row.source, row.options, row.seed, row.errors, row.error) for row in sweep.rows]


def fake(*means, size=5):
    """Return trainings with these mean errors; the largest error is ten times as large."""
    return [
        Trial(
            "arm",
            {"size": size},
            seed,
            "m",
            {
                readout: {
                    way: {"distance": {"mean": mean, "p99": 5 * mean, "max": 10 * mean}}
                    for way in ("forward", "inverse")
                }
                for readout in ("local", "activity", "winner")
            },
            1.0,
        )
        for seed, mean in enumerate(means)
    ]


# --- what is trained ----------------------------------------------------------------------


def test_every_combination_is_trained_with_every_seed_in_order(found):
    wanted = [({"size": s, "samples": 200}, k) for s, k in itertools.product([4, 5], [0, 1])]
    assert [(row.options, row.seed) for row in found.rows] == wanted
    assert [[row.seed for row in part] for part in found.combinations()] == [[0, 1], [0, 1]]
    assert not found.failed


def test_a_row_is_what_training_alone_gives(found):
    arm = calib.load_arm("two_link")
    alone = calib.train(calib.babble(arm, 200, seed=1), size=5, seed=1)
    assert found.rows[-1].errors == alone.about.errors
    assert found.rows[-1].unit == "m"
    assert found.rows[0].errors != found.rows[1].errors != found.rows[3].errors


@pytest.mark.parametrize("backend", ["loky", "threading"])
def test_numbers_are_the_same_whatever_runs_them(backend, found):
    pytest.importorskip("joblib")
    other = calib.sweep("two_link", {**GRID, "size": [5]}, seeds=2, jobs=2, backend=backend)
    assert (other.backend, other.jobs) == (backend, 2)
    assert numbers(other) == numbers(found)[2:]


def test_logs_are_swept_without_their_robot():
    log = calib.babble(calib.load_arm("two_link"), 200, seed=3, noise=1e-3)
    log = calib.Samples(log.q, log.x, log.joint_names, log.lower, log.upper, log.revolute)
    sweep = calib.sweep({"a": lambda: log}, {"size": [4]}, jobs=1)
    assert [row.source for row in sweep.rows] == ["a"]
    assert sweep.rows[0].errors == calib.train(log, size=4).about.errors
    (row,) = calib.sweep(log, {"noise": [0.0]}, jobs=1).rows
    assert "noise" in row.error


def test_threads_never_have_more_than_one_blas_thread():
    """The first training to end must not give their threads back to those that go on."""
    pytest.importorskip("joblib")
    seen = []

    def gain(*_):
        seen.append(max(p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"))
        raise calib.OptionError("enough")

    with threadpool_limits(2, user_api="blas"):
        calib.sweep("two_link", {"map": [gain], "samples": [50, 60]}, jobs=2, backend="threading")
        after = {p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"}
        assert after == {2}  # of this process' libraries, those that were loaded meanwhile too
    assert set(seen) == {1}


# --- what fails ---------------------------------------------------------------------------


def test_what_fails_is_a_row_and_the_others_go_on():
    grid = {"size": [4, (4, 4, 4)], "samples": [200]}
    sweep = calib.sweep(["two_link", "no_such_robot"], grid, jobs=1)
    good, bad, *lost = sweep.rows
    assert not good.error
    assert "4x4x4" in bad.error
    assert all("no_such_robot" in row.error for row in lost)
    assert sweep.failed == (bad, *lost)
    assert all(math.isnan(row.seconds) and not row.errors for row in sweep.failed)


def test_an_error_of_another_kind_is_one_line_too():
    def load():
        raise ZeroDivisionError("a\nb")

    (row,) = calib.sweep(load, jobs=1).rows
    assert row.error == "ZeroDivisionError: a b"


def test_a_backend_that_fails_keeps_what_is_done(monkeypatch, found):
    def broken(self, work, tasks):
        yield 1, found.rows[1]
        raise RuntimeError("a worker was killed")

    monkeypatch.setattr(backends.Backend, "run", broken)
    first, second, *_ = sweep = calib.sweep("two_link", GRID, seeds=2).rows
    assert second is found.rows[1]
    assert first.error == "not trained, the backend failed: RuntimeError: a worker was killed"
    assert [bool(row.error) for row in sweep] == [True, False, True, True]


@pytest.mark.parametrize(
    ("sources", "grid", "options", "said"),
    [
        ("two_link", {"sizes": [4]}, {}, "did you mean size"),
        ("two_link", {"map": "som"}, {}, "list of values"),
        ("two_link", {"size": []}, {}, "one value or more"),
        ("two_link", {"size": range(2, 103), "samples": range(100, 201)}, {}, "10,000"),
        ("two_link", {}, {"seeds": 10**9}, "10,000"),
        ("two_link", {}, {"seeds": 0}, "seeds 0"),
        ("two_link", {}, {"jobs": 0}, "jobs 0"),
        ("two_link", {}, {"backend": "mpi"}, "loky, threading, dask, ray"),
        ([], {}, {}, "nothing to learn from"),
    ],
)
def test_what_is_no_grid_is_refused_before_the_work(sources, grid, options, said):
    with pytest.raises(OptionError, match=said):
        calib.sweep(sources, grid, **options)


def test_without_joblib_it_runs_in_one_process_and_says_so(no_joblib, found):
    alone = calib.sweep("two_link", {**GRID, "size": [4]}, jobs=2)
    assert (alone.backend, alone.jobs) == ("", 1)
    assert "joblib is not installed" in alone.notes[0]
    assert numbers(alone) == numbers(found)[:1]
    with pytest.raises(OptionError, match="pip install joblib"):
        calib.sweep("two_link", backend="dask")


# --- tables -------------------------------------------------------------------------------


def test_seeds_are_told_together():
    from calib_cli.comparison import sweep_tables, together

    rows = fake(0.001, 0.003)
    result = together(rows, "local", "forward")
    assert result == {
        "mean": pytest.approx(0.002),
        "spread": pytest.approx(statistics.stdev([0.001, 0.003])),
        "max": pytest.approx(0.03),
    }
    (table,) = sweep_tables(calib.Sweep((*rows, *fake(0.002, 0.002, size=7))), ["local"])
    assert list(table.header[:5]) == ["source", "size", "forward", "sd", "max"]
    assert [row[:5] for row in table.rows] == [
        ["arm", "5", "2.000", "1.414", "30.00"],
        ["arm", "7", "2.000", "0", "20.00"],
    ]


def test_values_are_written_as_they_are_typed():
    values = [None, 30, (30, 40), (2.0, 0.5), "som", len]
    assert [written(value) for value in values] == ["", "30", "30x40", "2:0.5", "som", "len"]


@pytest.mark.parametrize("name", ["s.csv", "s.parquet"])
def test_a_file_has_a_row_for_each_training_in_full(name, run, tmp_path, found, asked):
    path = tmp_path / name
    done = run(*LINE, "--seeds", "2", "--jobs", "1", "-o", path)
    assert done.code == 0, done.err
    table = pl.read_csv(path) if name.endswith("csv") else pl.read_parquet(path)
    assert table["size"].to_list() == ["4", "4", "5", "5"] or table["size"].to_list() == [
        4,
        4,
        5,
        5,
    ]
    assert table["seed"].to_list() == [0, 1, 0, 1]
    for way, key in itertools.product(("forward", "inverse"), ("mean", "max")):
        wanted = [row.distance("winner", way, key) for row in found.rows]
        assert table[f"winner_{way}_{key}"].to_list() == wanted


# --- the command --------------------------------------------------------------------------


def test_the_command_asks_for_what_is_typed(run, asked):
    line = ("--size", "8,9x7", "--map", "som,vdsom:error", "--sigma", "2:0.5,3:1", "--seeds", "3")
    more = ("--noise", "0,0.001", "-n", "10,20", "--jobs", "4", "--backend", "threading")
    assert run("sweep", "two_link", "polar", *line, *more).code == 0
    ((sources, grid, options),) = asked
    assert sources == ["two_link", "polar"]
    assert grid == {
        "size": [8, (9, 7)],
        "map": ["som", "vdsom:error"],
        "sigma": [(2.0, 0.5), (3.0, 1.0)],
        "samples": [10, 20],
        "noise": [0.0, 0.001],
    }
    assert options == {"seeds": 3, "jobs": 4, "backend": "threading", "progress": None}


def test_the_command_prints_the_best_readouts_table_and_all_where_asked(run, asked):
    done = run("sweep", "two_link")
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert [line.split()[0] for line in lines if " readout: " in line] == ["local"]
    ways = ["forward", "sd", "max", "inverse", "sd", "max"]
    assert lines[1].split() == ["source", "size", *ways, "seconds"]
    assert lines[-1] == "4 trainings, one after the other"
    lines = run("sweep", "two_link", "-v").out.splitlines()
    shown = [line.split()[0] for line in lines if " readout: " in line]
    assert set(shown) >= {"local", "linear", "activity", "winner"}


def test_json_holds_every_training(run, found, asked):
    document = run(*LINE, "--seeds", "2", "--jobs", "1", "--json").document
    assert [row["errors"] for row in document["rows"]] == [row.errors for row in found.rows]
    assert (document["trainings"], document["failed"]) == (4, 0)
    best = document["combinations"][1]
    mean = statistics.fmean(r.distance("local", "forward", "mean") for r in found.rows[2:])
    assert best["errors"]["local"]["forward"]["mean"] == mean
    assert (best["seeds"], best["options"]) == ([0, 1], {"size": 5, "samples": 200})


def test_a_failure_is_told_and_the_rest_is_written(run, tmp_path, log):
    (tmp_path / "bad.csv").write_text("shoulder,elbow,x,y\n1,2,3,4\n")
    (tmp_path / "good.csv").write_bytes(log.read_bytes())
    path = tmp_path / "out.csv"
    pattern = tmp_path / "[a-z]*d.csv"
    done = run("sweep", "two_link", "--data", pattern, "--size", "4", "--jobs", "1", "-o", path)
    assert done.code == 1
    (error,) = (line for line in done.err.splitlines() if line.startswith("error: "))
    assert "bad.csv" in error
    assert "good.csv" in done.out
    with path.open() as file:
        bad, good = csv.DictReader(file)
    assert bad["error"]
    assert bad["local_forward_mean"] == "nan"
    assert not good["error"]
    assert float(good["local_forward_mean"]) > 0.0


@pytest.mark.parametrize(
    "line",
    [
        [],
        ["two_link", "two_link"],
        ["two_link", "polar", "--data", "a.csv"],
        ["--data", "-"],
        ["--data", "no such/*.csv"],
        ["--data", "a.csv", "--noise", "0"],
        ["two_link", "--unit", "mm"],
        ["two_link", "--size", "30,30"],
        ["two_link", "--size", "30,,50"],
        ["two_link", "--backend", "mpi"],
        ["two_link", "--seeds", "0"],
        ["two_link", "--json", "-o", "-"],
    ],
)
def test_wrong_usage_is_one_line_and_2(line, run):
    done = run("sweep", *line)
    assert (done.code, done.err.count("\n")) == (2, 1)
    if "--json" in line:
        assert done.document["error"]["type"] == "UsageError"
    else:
        assert done.out == ""


@pytest.mark.skipif(os.name == "nt", reason="signals and process groups of POSIX")
def test_ctrl_c_is_130_and_leaves_neither_words_nor_workers(tmp_path):
    pytest.importorskip("joblib")
    line = [sys.executable, "-m", "calib_cli", "sweep", "two_link", "-o", "out.csv"]
    line += ["--size", "60,70", "--seeds", "50", "--jobs", "2"]
    with subprocess.Popen(
        line, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        time.sleep(2.5)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        out, error = process.communicate(timeout=60)  # ends when the last worker has
    assert process.returncode in (130, -signal.SIGINT)
    assert (out, error) == (b"", b"")
    assert list(tmp_path.iterdir()) == []

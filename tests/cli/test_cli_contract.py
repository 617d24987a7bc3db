"""The contract of each command: its line, exit code, document, first words and units."""

import csv
import io
import json
import re
from dataclasses import replace
from functools import reduce
from operator import or_
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from reference import table

import calib

KINDS = json.loads((Path(__file__).parents[1] / "data" / "documents.json").read_text())
"""Of documents and their parts: keys ("*" for any) of names of Python, `[kind]`, `kind or kind`."""
CONTRACT = KINDS.pop("command lines")
"""With exit codes and documents; of `log`, `handeye`, `lerobot`: tests/recording, with pictures."""
FAILS = "THE BOUND DOES NOT HOLD"
FIRST_WORDS = KINDS.pop("first words")
QUIET = [
    "check m.calib --data moved.csv",
    "evaluate m.calib --data same.csv",
    "adapt m.calib --data moved.csv -o b.calib",
    "train two_link --data log.csv -o n.calib",
    "query forward m.calib 0.5 1.0",
    "query inverse m.calib 0.1 0.4",
]


def misfits(value, kind, place="document"):
    """Places of a value that are not of a kind."""
    kind = KINDS.get(kind, kind) if isinstance(kind, str) else kind
    if isinstance(kind, str) and " or " in re.sub(r"\[.*\]", "", kind):
        kind = re.split(r" or (?![^\[]*\])", kind)
    if isinstance(kind, dict) and isinstance(value, dict):
        kinds = dict.fromkeys(value, kind["*"]) if "*" in kind else kind
        bad = [f"{place}.{key}" for key in kinds.keys() ^ value.keys()]
        for key in kinds.keys() & value.keys():
            bad += misfits(value[key], kinds[key], f"{place}.{key}")
        return bad
    if isinstance(kind, str) and kind[0] == "[" and isinstance(value, list):
        return [bad for part in value for bad in misfits(part, kind[1:-1], f"{place}[]")]
    name = "null" if value is None else type(value).__name__
    fits = kind in (name, name.replace("int", "float"))
    if isinstance(kind, list):
        fits = any(misfits(value, part, place) == [] for part in kind)
    return [] if fits else [f"{place} is {value!r:.40}"]


@pytest.fixture(scope="module")
def home(tmp_path_factory, run):
    """A folder with a model of a log; logs of the same arm, of more noise, of a changed arm."""
    folder = tmp_path_factory.mktemp("contract")
    for words in (
        "log.csv -n 200",
        "same.csv -n 60 --seed 5",
        "noisy.csv -n 100 --seed 5 --noise 5e-4",
        "moved.csv -n 60 --seed 5 --change elbow.offset=0.02",
    ):
        run.done(f"babble two_link --noise 1e-4 -o {folder}/{words}")
    rows = (folder / "same.csv").read_text().splitlines()
    shaken = [row[:-3] for row in rows[1:]]  # the last digits are another reading
    (folder / "twice.csv").write_text("\n".join([*rows, *shaken]))
    (folder / "q.csv").write_text("shoulder,elbow\n0.5,1\n1,2\n")
    (folder / "x.csv").write_text("x,y\n0.1,0.4\n3,3\n")
    run.done(f"train two_link --data {folder}/log.csv --size 6 -o {folder}/m.calib")
    model = calib.load(folder / "m.calib")
    about = replace(model.about, within={"p95": 1e-3, "covered": 0.5}, tested=200)
    replace(model, about=about).save(folder / "bad.calib")
    return folder


@pytest.fixture(autouse=True)
def _there(home, monkeypatch):
    monkeypatch.chdir(home)


@pytest.mark.parametrize(("line", "code", "kind"), CONTRACT, ids=[row[0] for row in CONTRACT])
def test_a_command_ends_with_its_code_and_its_document(run, line, code, kind):
    done = run(f"{line} --json")
    assert done.code == code, done.err
    whole = reduce(or_, map(KINDS.get, kind.split(" + ")))
    assert misfits(done.document, whole) == []


@pytest.mark.parametrize(("line", "code", "first"), FIRST_WORDS)
def test_what_limits_an_answer_is_said_first(run, line, code, first):
    done = run(line)
    assert (done.code, done.out[: len(first)]) == (code, first)


def test_a_check_whose_bound_fails_without_noise_ends_with_3(run, monkeypatch):
    """Calm rows, no cause, and a bound that too few of them keep: in CONTRACT they end with 0."""
    monkeypatch.setattr(calib.Verdict, "covered", 0.5)
    monkeypatch.setattr(calib.Verdict, "bound_holds", False)
    done = run("check m.calib --data same.csv")
    assert done.code == 3
    assert done.out.startswith(FAILS)


def test_a_page_that_is_shown_leaves_a_document_alone(run, monkeypatch):
    monkeypatch.setattr("time.sleep", Mock(side_effect=KeyboardInterrupt))
    done = run("preview m.calib --no-open --json")
    assert done.document["url"] in done.err


@pytest.mark.parametrize("words", QUIET)
def test_quiet_is_one_line_and_no_note(run, words):
    done = run(f"{words} --quiet")
    assert done.err == ""
    assert len(done.out.splitlines()) == 1


def test_positions_are_typed_and_printed_in_the_unit_asked_for(run):
    plain = run("query inverse m.calib 0.1 0.4 --json").document
    asked = run("query inverse m.calib 100 400 --unit mm --json").document
    assert asked == plain  # documents are in the model's unit
    done = run("query forward m.calib 0.5 1.0 --unit cm")
    position = [float(word) for word in done.out.splitlines()[1].split()[2:4]]
    assert position == pytest.approx(100 * calib.load("m.calib").forward([0.5, 1.0]), abs=1e-3)
    assert "x [cm]" in done.out
    done = run("query inverse m.calib --input - --unit mm", stdin="x,y\n100,400\n")
    (answer,) = csv.DictReader(io.StringIO(done.out))
    (solution,) = plain["solutions"]
    assert float(answer["elbow"]) == pytest.approx(solution["joints"]["elbow"], abs=1e-6)
    assert (float(answer["x"]), float(answer["y"])) == pytest.approx((100.0, 400.0))
    bound = float(answer["expected_error"])
    assert bound == pytest.approx(1e3 * solution["expected_error"], rel=1e-6)


@pytest.mark.parametrize(("factor", "offset"), [(1e3, 0.0), (640.0, 500.0), (1.0, 0.3)])
def test_a_log_of_another_unit_or_frame_is_told(run, tmp_path, factor, offset):
    samples = calib.babble(calib.load_arm("two_link"), 40, seed=8, noise=1e-4)
    rows = np.hstack([samples.q, factor * samples.x + offset])
    path = table(tmp_path / "log.csv", [*samples.joint_names, "x", "y"], rows)
    done = run("evaluate", "m.calib", "--data", path)
    assert done.code == 3
    assert FAILS in done.out
    if factor != 1e3:
        return
    assert "--unit mm" in done.err
    run.refused(1, "in mmm, the model in m", f"evaluate m.calib --data {path} --unit mmm")
    adapt = f"adapt m.calib --data {path} -o {tmp_path}/a.calib"
    raw = run(f"{adapt} -v").out
    assert " sensor units before" in raw  # and not mm, which it was not told
    assert "--unit mm" in raw
    assert run(f"{adapt} --unit mm --json").document["unit"] == "m"
    looked = run(f"check m.calib --data {path} -v")
    assert looked.code == 3
    assert "check the log's unit before calib adapt" in looked.out
    assert "sensor units" in looked.out
    assert "`" not in looked.out


def test_what_is_found_is_more_than_the_rows_leave_open(run):
    for log, words in (("log.csv", "found: nothing"), ("moved.csv", "found: elbow: +")):
        assert words in run(f"train two_link --data {log} --size 2 -o n.calib").out


def test_a_log_of_a_simulated_arm_is_judged_as_a_log(run, tmp_path):
    log = calib.babble(calib.load_arm("two_link"), 40, seed=8, noise=1e-3)
    rows = np.hstack([log.q, log.x])
    path = table(tmp_path / "log.csv", ["shoulder", "elbow", "x", "y"], rows)
    assert "simulated noise" not in run(f"evaluate m.calib --data {path}").out
    path = table(path, ["elbow", "shoulder", "x", "y"], rows)
    run.refused(1, "error: the log fits the robot only if", f"check m.calib --data {path}")


def test_a_planar_log_without_a_tip_is_told_whose_positions_it_has(run, tmp_path):
    """A wrist that was measured and a tool that was taken are an offset of the elbow."""
    log = calib.babble(calib.load_arm("three_link", ["shoulder", "elbow"], "tip"), 60, noise=1e-4)
    calib.write_log(log, tmp_path / "log.csv")
    words = f"--joints shoulder,elbow --data {tmp_path}/log.csv --size 5 -o {tmp_path}/m.calib"
    assert "--tip" in run(f"train three_link {words}").err
    assert "those of tip" not in run(f"train three_link {words} --tip tip").err

"""The contract of each command: its line, exit code, document, first words; and bad input."""

import ast
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
from calib_cli.errors import describe_error
from conftest import refused
from reference import table

import calib

KINDS = json.loads((Path(__file__).parents[1] / "data" / "documents.json").read_text())
"""Of documents and their parts: keys ("*" for any) of names of Python, `[kind]`, `kind or kind`."""
CONTRACT = KINDS.pop("command lines")
"""With exit codes and documents; of `log`, `handeye`, `lerobot`: tests/recording, with pictures."""
FAILS = "THE BOUND DOES NOT HOLD"
FIRST_WORDS = KINDS.pop("first words")
QUIET = KINDS.pop("quiet lines")


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
    assert misfits(done.document, reduce(or_, map(KINDS.get, kind.split(" + ")))) == []


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


ROOT = Path(__file__).parents[2]
# what is typed, the exit code, and words that the line must hold
CASES = KINDS.pop("refusals")
INTERRUPTED = RuntimeError("Error calling __set_name__")
UNEXPECTED = [
    (MemoryError(), 1, "not enough memory; use a smaller --size or fewer --samples"),
    (PermissionError(13, "Permission denied", "a.csv"), 1, "a.csv: Permission denied"),
    (OSError(28, "No space left on device"), 1, "No space left on device"),
    (TypeError("a\nb"), 1, "internal error, TypeError: a b; CALIB_TRACEBACK=1 shows"),
    (INTERRUPTED, 130, "interrupted"),
]
EXCHANGED = [
    lambda model, log: calib.check(log, model),
    lambda model, log: calib.adapt(log, model),
    lambda model, log: calib.judge(log, model),
    lambda model, log: calib.evaluate(log, model),
    lambda model, log: calib.correct([0.5, 1.0], model),
    lambda model, log: calib.recognise(log, [model]),
    lambda model, log: calib.report("page.html", model),
    lambda model, log: calib.preview("page.html", model),
    lambda model, log: calib.write_log("log.csv", log),
    lambda model, log: calib.figures((model.motor, model.sensory)),
    lambda model, log: calib.train(log, size=5, sigma=(5,)),
    lambda model, log: calib.babble("two_link"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, model) -> Path:
    """A folder with one good model, one without a body, and many bad files."""
    path = tmp_path_factory.mktemp("bad")
    urdf = (ROOT / "robots" / "two_link.urdf").read_bytes()
    (path / "own.urdf").write_bytes(urdf)
    (path / "truncated.urdf").write_bytes(urdf[: len(urdf) // 2])
    replace(calib.load(model), body=None).save(path / "bare.calib")
    (path / "few.csv").write_text("shoulder,elbow,x,y\n.1,1,.1,.2\n.2,1.1,.2,.3\n.3,1.2,.3,.4\n")
    (path / "missing.csv").write_text("shoulder,x,y\n0,0.1,0.2\n1,0.2,0.3\n")
    (path / "good.calib").write_bytes(model.read_bytes())
    return path


@pytest.mark.parametrize(("line", "code", "words"), CASES, ids=[case[0] for case in CASES])
def test_one_line_and_a_document_and_nothing_written(run, folder, monkeypatch, line, code, words):
    monkeypatch.chdir(folder)
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    alone = line in ("query", "train two_link -o -")  # --json would be a fault of its own
    done = run(*line.replace(" --json", "").split(), *([] if alone else ["--json"]))
    assert done.code == code, done.err
    assert (done.err.count("\n"), done.err[-1]) == (1, "\n")
    assert [word for word in words.split(" ") if word not in done.err] == []
    if alone:
        return
    error = done.document["error"]
    assert set(error) == {"type", "message", "hint", "parameter", "value"}
    assert error["type"].endswith("Error")
    message = error["message"] if error["hint"] is None else f"{error['message']}; {error['hint']}"
    assert done.err == f"error: {message}\n"
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before


INTERRUPTED.__cause__ = KeyboardInterrupt()


@pytest.mark.parametrize(("error", "code", "line"), UNEXPECTED)
def test_unexpected_errors_are_one_line_too(error, code, line):
    found, told = describe_error(error)
    assert found == code
    assert told["message"].startswith(line)
    assert "\n" not in told["message"]


def test_library_errors_name_parameters_and_the_command_line_options(run):
    told = refused(calib.RobotError, "elbw", calib.load_arm, "two_link", ["shoulder", "elbw"])
    assert "--" not in str(told)
    assert (told.parameter, told.value) == ("joints", "elbw")
    error = run("train two_link --joints shoulder,elbw --json").document["error"]
    assert (error["type"], error["parameter"], error["value"]) == ("RobotError", "--joints", "elbw")
    assert "elbow?" in error["hint"]
    assert "`" not in error["message"]


@pytest.mark.parametrize("call", EXCHANGED)
def test_arguments_of_python_that_are_exchanged_are_told_in_one_line(model, call):
    log = calib.babble(calib.load_arm("two_link"), 20)
    refused(calib.OptionError, "expected|give", call, calib.load(model), log)


def test_no_message_of_the_library_names_an_option():
    """Of text in the source only docstrings may speak of the command line."""
    foreign = ("var(", "pip install", "static inline", "use_degrees=true")
    foreign += ("calib check MODEL", "calib adapt MODEL")  # the report to its readers
    found = []
    for path in (ROOT / "calib").rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        docs = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        for node in nodes:
            text = node.value if isinstance(node, ast.Constant) and id(node) not in docs else None
            flag = isinstance(text, str) and re.search(r"(?<![\w-])--[a-z]+", text)
            # of rig.py: command lines of ROS
            if flag and path.name != "rig.py" and not any(word in text for word in foreign):
                found.append(f"{path.name}:{node.lineno} {flag[0]}")
    assert found == []

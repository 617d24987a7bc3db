"""Bad input: one clear line on standard error, nothing on standard output, no file."""

import ast
import re
from pathlib import Path

import pytest
from calib_cli.errors import describe_error
from refusals import refused

import calib

ROOT = Path(__file__).parents[2]
# what is typed, the exit code, and words that the line must hold
CASES = [
    ("train", 2, "ROBOT"),
    ("train two_link --joints shoulder,shoulder", 2, "--joints once"),
    ("train two_link --lock elbow", 2, "--lock 'elbow' JOINT=VALUE"),
    ("train two_link --lock elbow=1 --lock elbow=2", 2, "--lock 'elbow' twice"),
    ("train two_link --size 0", 2, "--size '0' 70x70 (see calib train --help)\n"),
    ("train two_link --sigma 3", 2, "--sigma '3' START:END"),
    ("train two_link --samples 0", 2, "--samples '0'"),
    ("train two_link --noise -1", 2, "--noise '-1' zero or more"),
    ("train two_link --noise 1e308", 1, "noise below 1e+15"),
    ("train two_link --change longer", 2, "--change 'longer' elbow.length"),
    ("train two_link --columns x=u", 2, "--columns --data"),
    ("train two_link --data few.csv --noise 1", 2, "--noise --data"),
    ("train two_link --data few.csv --prismatic elbow", 2, "--prismatic ROBOT"),
    ("train two_link -o -", 2, "file"),
    ("train two_link --frobnicate", 2, "--frobnicate"),
    ("train two_link --data missing.csv", 1, "elbow --columns"),
    ("train --data few.csv", 1, "--joints 'shoulder'"),
    ("query", 2, "command"),
    ("query inverse good.calib 0.1", 2, "1 expected 2 x, y"),
    ("query inverse good.calib a b", 2, "'a' number"),
    ("query inverse good.calib 0.1 0.4 --near 1,9", 2, "--near elbow 9"),
    ("query inverse good.calib 0.1 0.4 --all --readout winner", 2, "--all"),
    ("query inverse good.calib 0.1 0.4 --output a.csv", 2, "--output --input"),
    ("query inverse good.calib 0.1 0.4 --input few.csv", 2, "--input"),
    ("query inverse good.calib --json --input few.csv --output -", 2, "--json"),
    ("query forward good.calib --input missing.csv", 1, "'elbow'"),
    ("babble two_link -n 10 -o - --json", 2, "--json"),
    ("frobnicate", 2, "frobnicate"),
    # what is read is never replaced: a log became a model
    ("train two_link --data few.csv -o few.csv", 2, "few.csv replace"),
    ("train truncated.urdf -o truncated.urdf", 2, "truncated.urdf replace"),
    ("adapt good.calib --data few.csv -o few.csv", 2, "few.csv replace"),
    ("query forward good.calib --input few.csv -o ./few.csv", 2, "few.csv replace"),
    ("log a.png --tag 1 --tags-at few.csv -o few.csv", 2, "few.csv replace"),
    ("handeye a --poses-file few.csv --board 4x4:9mm --eye hand --transform few.csv", 2, "replace"),
    ("log few.csv --tag 1 --picture few.csv -o l.csv", 2, "--picture few.csv replace"),
    ("check good.calib --data few.csv --data few.csv", 2, "--data 2 times"),
    ("train few.csv", 2, "table --data few.csv"),
    ("handeye a --poses-file few.csv --board 10x7:22mm --eye hand --tip t", 2, "--tip ROBOT"),
    ("log a --board 10x7:22mm --eye hand --tag 7 -o l.csv", 2, "--tag --eye"),
    ("train good.calib", 1, "good.calib: URDF"),
    ("train --data few.csv --joints shoulder,elbow --tip tip", 2, "--tip ROBOT"),
    ("train --data few.csv --joints shoulder,elbow --planar", 2, "--planar ROBOT"),
    ("check good.calib --data few.csv --tolerance -1", 2, "--tolerance '-1' zero"),
    # words of the options that were typed, not of the library's parameters
    ("train two_link --rule foo", 2, "'--rule' 'foo' one of 'batch',"),
    ("train two_link --range foo=0:1", 1, "--range: 'foo' shoulder"),
    ("query path good.calib --input few.csv --from 9,9", 2, "--from shoulder 9 range"),
    ("query inverse good.calib 0.1 0.4 --rpy 0,0,1", 1, "arm that moves in space"),
    ("plan six_axis --touch 0.3,0.3 -o p.csv", 2, "--touch '0.3,0.3' three"),
    ("plan six_axis --handeye --board 10x7:22mm -o p.csv", 2, "--from middle"),
    ("export good.calib --lerobot old.json", 2, "--lerobot -o"),
    ("report good.calib --figures few.csv", 2, "--figures 'few.csv' folder"),
    # endings that are not of what is written: SVG was written into tag.png
    ("tag 7 -o tag.png", 2, "tag.png"),
    ("train two_link -n 20 -o few.csv", 2, "few.csv .calib"),  # a log became a model
    ("adapt good.calib --data missing.csv -o few.csv", 2, "few.csv .calib"),
    ("query inverse good.calib --input few.csv --output k.xlsx", 2, "k.xlsx"),
    ("babble two_link -n 5 -o log.json", 2, "log.json"),
    ("export good.calib -o arm.py", 2, "arm.py"),
    ("report good.calib -o page.pdf", 2, "page.pdf"),
    ("plan two_link", 2, "-o"),
    ("plan two_link -n 5000 -o p.csv", 2, "1000"),
    ("plan two_link --margin 2 -o p.csv", 1, "room shoulder"),
    ("plan two_link --from 1 -o p.csv", 2, "2 values"),
    ("plan two_link --from 1,9 -o p.csv", 1, "--from: elbow 9"),
    ("plan good.calib --tip t -o p.csv", 2, "--tip ROBOT"),
    ("plan good.calib --planar -o p.csv", 2, "--planar ROBOT"),
    ("evaluate good.calib --distance a,b=50mm", 2, "--distance --data"),
    ("evaluate good.calib --frame free", 2, "--frame --data"),
    ("check good.calib --data few.csv --camera left", 2, "--camera LeRobotDataset"),
]
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
    """A folder with one good model and many bad files."""
    path = tmp_path_factory.mktemp("bad")
    urdf = (ROOT / "robots" / "two_link.urdf").read_bytes()
    (path / "truncated.urdf").write_bytes(urdf[: len(urdf) // 2])
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

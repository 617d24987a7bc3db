"""Command lines: good and bad values of every command and option that the program has."""

import re
import unicodedata
from collections import Counter

import pytest
import typer
from calib_cli.app import INPUTS, OUTPUTS, application
from hypothesis import given
from hypothesis import strategies as st

import calib
from hostile.guard import LONGEST, NAMES, NUMBERS, damaged, guarded, inputs

LEFT_OUT = {"reproduce", "report", "handeye"}
"""Commands that start processes or draw a dozen figures: their own tests ask them."""
NEVER = {"--camera", "--port", "--size", "--samples", "--help"}
"""Options that wait for a device or a user, and those that every line here sets small."""
BAD = st.one_of(NAMES, NUMBERS, st.sampled_from((
    "9" * 5000, "4294967296x4294967296", "3x", "1:0", "nan:1", "nan,1", ",", "1e308,1e308",
    "elbow=nan", "elbow=1e308", "elbow=1:0", "x=y", "x=x,x=y", "elbow.length=1e308",
    "elbow.length=-100%", "a.b=c", ".=", "vdsom:x", "polar", "bad.calib", "bad.csv", "bad.urdf",
    "m.calib", "log.csv", "far.csv", "folder", "none", "/dev/null", "/dev/full", "/dev/zero",
    "folder/none/x", "/proc/self/mem", "~/x",
)))  # fmt: skip
"""What is typed wrongly, for whatever it is typed."""
GOOD = {  # by option, else by metavar
    "--output": ("out.csv", "out.calib", "new.parquet", "folder/out.html", "out.urdf", "log.csv"),
    "--html": ("p.html",), "--photo": ("none",), "--joints-file": ("log.csv",),
    "--data": ("log.csv", "log.csv", "bent.csv", "log.parquet", "bad.csv"),
    "--input": ("q.csv", "x.csv", "far.csv", "log.csv", "-"), "MODEL": ("m.calib", "l.calib"),
    "ROBOT": ("two_link", "two_link_full"), "ROBOT|MODEL": ("two_link", "r.urdf", "m.calib"),
    "BAG|PICTURES|VIDEO": ("log.csv", "none.bag", "folder"), "A,B": ("shoulder,elbow",),
    "FRAME": ("tip", "forearm"), "JOINT=VALUE": ("elbow=1.5", "shoulder=1"),
    "JOINT=LO:HI": ("elbow=0.5:1.5", "shoulder=0.1:1.1"), "--map": ("vdsom", "som", "vdsom:error"),
    "N|NxN": ("3", "4x3"), "N": ("5", "3"), "--epochs": ("1", "2"), "START:END": ("2:0.5", "1:1"),
    "K": ("0", "7"), "S": ("0", "0.001"), "L": ("0.1",), "M": ("0.1", "5%"),
    "JOINT.WHAT=VALUE": ("elbow.length=+20%", "sensor.mirror=x", "elbow.backlash=0.01"),
    "x=U,y=V": ("x=x,y=y",), "m|mm|px|..": ("m", "mm", "px"), "--prismatic": ("elbow",),
    "Q1,Q2": ("0.5,1", "1,1"), "--step": ("0.01", "0.1"), "Q1 Q2": ("0.3", "1.0", "-0.1"),
    "X Y [Z]": ("0.3", "0.25", "-0.1"), "R,P,Y": ("0,0,1",), "QX,QY,QZ,QW": ("0,0,0,1",),
    "40mm": ("40mm",), "ID": ("7",),
}  # fmt: skip
# what a terminal would obey
RAW = {chr(c) for c in (*range(9), *range(11, 32), *range(127, 160), *range(0x202A, 0x202F))}


def commands(command, words=()):
    """Every command of the program that does something, with the words that call it."""
    if not hasattr(command, "commands"):
        yield words, command
        return
    context = typer.Context(command)
    for name in command.list_commands(context):
        if name not in LEFT_OUT:
            yield from commands(command.get_command(context, name), (*words, name))


COMMANDS = list(commands(typer.main.get_command(application())))


@st.composite
def typed(draw, part, careful):
    """What may be typed for an argument or an option."""
    name, kind = part.opts[0], part.metavar or ""
    if getattr(part, "is_flag", False):
        return [name]
    choices = tuple(kind.split("|")) if re.fullmatch(r"[a-z-]+(\|[a-z-]+)+", kind) else ("x",)
    value = st.sampled_from(GOOD.get(name) or GOOD.get(kind) or choices)
    if not careful:
        value = value | BAD | BAD
    count = 1
    if part.nargs == -1:
        count = 2 if careful else draw(st.sampled_from((2, 2, 0, 40)))
    values = draw(st.lists(value, min_size=count, max_size=count))
    return [name, *values] if name.startswith("-") else values


@st.composite
def lines(draw):
    """A command line; the sizes that it asks for are small."""
    words, command = draw(st.sampled_from(COMMANDS))
    # all good, so that the command gets to work; one bad value; or several
    way = draw(st.sampled_from(("good", "good", "good", "good", "one", "wild")))
    parts = [p for p in command.params if p.opts[0] not in NEVER]
    one = draw(st.sampled_from(parts)) if parts else None
    args = list(words)
    for part in parts:
        careful = way == "good" or (way == "one" and part is not one) or draw(st.booleans())
        if part.required or not careful or draw(st.integers(0, 7)) == 7:
            args += draw(typed(part, careful))
    options = {option for part in command.params for option in part.opts}
    args += ["--html", "p.html"] if words[0] == "preview" and "--html" not in args else []
    args += ["--size", "3"] if words[0] == "train" else []
    args += ["--samples", "60"] if "--samples" in options and "--data" not in args else []
    if way == "wild":  # an argument that nobody asked for
        odd = st.sampled_from(("--", "-h", "--help", "--version", "--no-such", "--json"))
        args.insert(draw(st.integers(1, len(args))), draw(odd | NAMES))
    return args


@pytest.fixture(scope="module")
def home(tmp_path_factory, run):
    """A folder with models, logs and tables."""
    folder = tmp_path_factory.mktemp("work")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for args in (
            "train two_link --size 5 -n 300 -o m.calib",
            "babble two_link -n 60 -o log.csv",
            "babble two_link -n 30 -o log.parquet",
            "babble two_link -n 40 --change elbow.length=+20% -o bent.csv",
            "train --data log.csv --joints shoulder,elbow --size 4 -o l.calib",
        ):
            run.done(args)
        (folder / "folder").mkdir()
        (folder / "q.csv").write_text("shoulder,elbow\n0.5,1\n1,2\n-9,0\n")
        (folder / "x.csv").write_text("x,y\n0.3,0.3\n0.3,0.31\n")
        (folder / "far.csv").write_text("x,y\n0.3,0.3\n1e308,-1e308\nnan,1\na,b\n")
        (folder / "r.urdf").write_text(calib.load_arm("two_link").urdf)
        yield folder


def judge_output(args, done):
    """Check the exit code, what is said, and the JSON document; they are as the README says."""
    code, out, err = done.code, done.out, done.err
    said = f"{args!r}, exit code {code}: {out[:300]!r} {err[-500:]!r}"
    for text in (out, err):
        assert not re.search("Traceback|internal error|Warning", text), said
        odd = {c for c in text if unicodedata.category(c) in ("Cc", "Zl", "Zp")} - {"\n"}
        assert not odd | (RAW & set(text)), said
    lines = err.splitlines()
    assert all(len(text) <= LONGEST for text in lines), said
    errors = [text for text in lines if text.startswith("error: ")]
    asked = "--json" in args and "--" not in args and not {"--help", "--version", "-h"} & set(args)
    if asked and (code in (0, 3) or errors):
        assert (set(done.document) == {"error"}) == bool(errors), said
    if code == 2:
        others = [text for text in lines if not text.startswith("note: ")]
        assert len(others) == len(errors) == 1, said
        assert "--json" in args or not out, said
    elif code == 1:  # of a batch, the others are answered
        assert errors or "not all values are numbers" in err or "left out" in err, said
        assert len(errors) <= 1, said
    else:
        assert code in (0, 3), said
        assert not errors, said
        assert code == 0 or lines or out, said


def test_command_lines_end_in_order(home, run):
    kept = {path.name: path.read_bytes() for path in home.iterdir() if path.is_file()}
    bases = {"bad.calib": "m.calib", "bad.csv": "log.csv", "bad.urdf": "r.urdf"}
    stdins = st.sampled_from(("", "x,y\n0.3,0.3\n", "shoulder,elbow\n0.1,0.5\n", "\0\n", "a"))
    found = Counter()

    @inputs(160)
    @given(lines(), stdins, st.data())
    def judge(args, stdin, drawn):
        for name, base in bases.items():
            if name in args:
                (home / name).write_bytes(drawn.draw(damaged(kept[base], 2)))
        with guarded(home, (*args, *(arg.partition("=")[2] for arg in args))):
            done = run(*args, stdin=stdin)
        judge_output(args, done)
        for name, data in kept.items():
            path = home / name
            if not path.exists() or path.read_bytes() != data:
                # named as an output it may be replaced, but by no error
                assert done.code != 2, f"{name} changed"
                assert any(name in arg for arg in args), f"{name} changed"
                path.write_bytes(data)
        for path in home.iterdir():
            if path.is_file() and path.name not in kept:
                assert not path.name.endswith(".tmp"), f"{path.name} was left behind"
                path.unlink()
        found[done.code] += 1

    judge()
    assert set(found) == {0, 1, 2, 3}, found


def test_which_files_a_command_reads_and_writes_is_listed():
    parts = [part for _, command in COMMANDS for part in command.params]
    files = {p.name for p in parts if re.search(r"(FILE|LOG|MODEL)\b", p.metavar or "")}
    assert files - {*INPUTS, *OUTPUTS} == {"camera", "log", "model", "models", "photo"}


@pytest.mark.parametrize("name", ["\x1b]0;own\x07", "\x1b[2J", "\u202eel", "a\nb", "\x9b2J", "\t"])
def test_no_name_reaches_the_terminal_raw(home, run, name):
    table = home / "q.csv"
    before = table.read_bytes()
    table.write_text(f'shoulder,elbow,"{name}"\n0.5,1,1\n')
    for args in (
        ["query", "forward", "m.calib", "--input", "q.csv", "--output", "o.csv"],
        ["query", "forward", "m.calib", "--input", "q.csv", "--json"],
        ["train", "two_link", "--joints", f"shoulder,{name}"],
        ["train", "two_link", "--lock", f"{name}=1", "--json"],
        ["info", f"none{name}"],
        ["babble", "two_link", "-n", "5", "-o", f"none/{name}.csv"],
    ):
        judge_output(args, run(*args))
    table.write_bytes(before)
    (home / "o.csv").unlink()

"""The contract of each command: what is typed, how it ends, and the keys of its JSON document."""

from dataclasses import replace

import pytest

import calib

MODEL = (
    "model robot joints tip plane view map rule size samples left_out seed seconds unit units "
    "bound_of bound_holds sensors errors "
)
ANSWER = "unit bound_of units "
BATCH = f"output rows invalid out_of_reach {ANSWER}"
DRIFT = (
    "model drifted samples outliers left_out score smallest tolerance adapts bound_holds covered "
    "threshold distortion fired causes smallest_by_group explanations noise false_alarm episodes "
    "unit units"
)

CONTRACT = [
    ("train two_link --size 5 -n 300 -o n.calib", 0, MODEL),
    ("train --data log.csv --joints shoulder,elbow --size 5 -o n.calib", 0, MODEL),
    ("info m.calib", 0, MODEL + "ranges joint_units locked source simulation options history body "
     "rows notes backlash"),
    ("evaluate m.calib", 0, MODEL + "evaluated learned"),
    ("evaluate m.calib --data same.csv", 0, MODEL + "evaluated learned"),
    ("evaluate m.calib --data moved.csv", 3, MODEL + "evaluated learned"),
    ("query forward m.calib .5 1", 0, "joints position expected_error model_error " + ANSWER),
    ("query forward m.calib .5 9", 3, "joints position expected_error model_error " + ANSWER),
    ("query forward m.calib --input q.csv", 0, BATCH + "answers"),
    ("query inverse m.calib .1 .4", 0, "target reachable solutions " + ANSWER),
    ("query inverse m.calib 5 5", 3, "target reachable solutions " + ANSWER),
    ("query inverse m.calib --input x.csv", 3, BATCH + "answers"),
    ("query path m.calib --input x.csv", 3, BATCH + "jumps left_out path"),
    ("check m.calib --data same.csv", 0, DRIFT),
    ("check m.calib --data moved.csv", 3, DRIFT),
    ("adapt m.calib --data moved.csv -o a.calib", 0, "model improved samples outliers left_out "
     "correction kept coverage everywhere before after method changed notes unit units"),
    ("recognise m.calib --data moved.csv", 3, "model samples fits"),
    ("correct m.calib --input q.csv", 0, BATCH + "beyond_limit change answers"),
    ("urdf m.calib -o new.urdf", 0, "urdf offsets base moved frame frame_fitted residual before "
     "reach unit units"),
    ("export m.calib -o arm.h", 0, "model bytes table_bytes output"),
    ("babble two_link -n 5 -o b.csv", 0, "log robot joints samples seed noise changes unit units"),
    ("plan m.calib -n 5 -o p.csv", 0, "output rows joints seed travel poses start length "
     "random_length unit why units"),
    ("tag 7 -o tag.svg", 0, "output what"),
]  # fmt: skip


@pytest.fixture(scope="module")
def home(tmp_path_factory, run):
    """A folder with a model of a log, the log, and logs of the same and of a changed arm."""
    folder = tmp_path_factory.mktemp("contract")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        babble = "babble two_link --noise 1e-4 -o"
        run(*f"{babble} log.csv -n 200".split())
        run(*f"{babble} same.csv -n 60 --seed 5".split())
        run(*f"{babble} moved.csv -n 60 --seed 5 --change elbow.offset=0.02".split())
        (folder / "q.csv").write_text("shoulder,elbow\n0.5,1\n1,2\n")
        (folder / "x.csv").write_text("x,y\n0.1,0.4\n3,3\n")
        train = "train two_link --data log.csv --size 6 -o"
        run(*f"{train} m.calib".split())
    return folder


@pytest.mark.parametrize(("line", "code", "keys"), CONTRACT, ids=[row[0] for row in CONTRACT])
def test_a_command_ends_with_its_code_and_its_document(run, home, monkeypatch, line, code, keys):
    monkeypatch.chdir(home)
    done = run(*line.split(), "--json")
    assert done.code == code, done.err
    assert set(done.document) == set(keys.split())


def test_the_catalogue_is_a_list(run):
    entries = run("robots", "--json").document
    assert [entry["name"] for entry in entries] == [entry.name for entry in calib.list_robots()]
    assert all(set(entry) == {"name", "joints", "dof", "description"} for entry in entries)
    assert all(entry["dof"] == len(entry["joints"]) for entry in entries)
    assert len(run("robots").out.splitlines()) == 1 + len(entries)  # a header, then one line each


def test_no_figure_of_a_model_whose_bound_fails_ends_with_0(run, home, monkeypatch):
    monkeypatch.chdir(home)
    model = calib.load("m.calib")
    about = replace(model.about, within={"p95": 1e-3, "covered": 0.5}, tested=200)
    replace(model, about=about).save("bad.calib")
    for line in ("info bad.calib", "evaluate bad.calib", "report bad.calib -o r.html"):
        done = run(*line.split())
        assert (done.code, line) == (3, line)
        assert done.out.startswith("THE BOUND DOES NOT HOLD")


def test_a_check_whose_bound_fails_without_noise_ends_with_3(run, home, monkeypatch):
    """Calm rows, no cause, and a bound that too few of them keep."""
    monkeypatch.chdir(home)
    line = "check m.calib --data same.csv"
    assert run(*line.split()).code == 0
    monkeypatch.setattr(calib.Verdict, "covered", 0.5)
    monkeypatch.setattr(calib.Verdict, "bound_holds", False)
    done = run(*line.split())
    assert done.code == 3
    assert done.out.startswith("THE BOUND DOES NOT HOLD")

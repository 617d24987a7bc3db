"""Fixtures that tests share: commands, small models and logs, one thread."""

import gc
import io
import json
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import calib

# a deadline would test how busy the machine is
settings.register_profile("own", deadline=None, derandomize=True, suppress_health_check=HealthCheck)
settings.load_profile("own")
# of small matrices several threads would wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@dataclass(frozen=True)
class Outcome:
    """How a command line ended: its exit code and what it printed."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict:
        """The only JSON document on standard output."""
        return json.loads(self.out, parse_constant=pytest.fail)


class Program:
    """The command line within this process."""

    def __call__(self, *args: object, stdin: str = "") -> Outcome:
        """Run a command line, of words or in one string."""
        from calib_cli.app import run

        words = args[0].split() if len(args) == 1 and isinstance(args[0], str) else args
        out, err, before = io.StringIO(), io.StringIO(), sys.stdin
        sys.stdin = io.TextIOWrapper(io.BytesIO(stdin.encode()))
        try:
            with redirect_stdout(out), redirect_stderr(err):
                code = run([str(word) for word in words])
        finally:
            sys.stdin = before
        return Outcome(code, out.getvalue(), err.getvalue())

    def done(self, *args: object, stdin: str = "") -> Outcome:
        """Run a command line that has to end with exit code 0."""
        outcome = self(*args, stdin=stdin)
        assert outcome.code == 0, outcome.err
        return outcome

    def refused(self, code: int, words: str, *args: object) -> Outcome:
        """Run a command line that has to end with another code, and words on standard error."""
        outcome = self(*args)
        assert outcome.code == code, outcome.err
        assert words in outcome.err
        return outcome


run_in_process = Program()


def refused(error, words, call, *values, **options):
    """Call, and return the error: of this kind, in one line that a pattern finds words in."""
    with pytest.raises(error, match=words) as caught:
        call(*values, **options)
    assert "\n" not in str(caught.value)
    return caught.value


def lengths(x):
    """Lengths (n,) of vectors (n, m)."""
    return (x**2).sum(axis=1) ** 0.5


def pytest_collection_modifyitems(items):
    """Put quick files last, so that no worker waits long for the others' end."""
    last = {"hostile": 1, "arm": 2}
    items.sort(key=lambda item: last.get(item.path.parent.name, 0))
    gc.freeze()  # all that was imported would be searched again and again


@pytest.fixture(autouse=True)
def _quick_compiler(monkeypatch):
    """Optimise no C, in a sixth of the time; one test of the kernel does it as users do."""
    from calib.kernel.compiled import Compiler

    monkeypatch.setattr("calib.kernel.compiled.COMPILER", Compiler(quick=("-O0",)))


@pytest.fixture(autouse=True, scope="session")
def _fewer_points():
    """Test simulated models at a tenth of the points, but where `all_points` is asked for."""
    from calib.training import residuals

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(residuals, "TESTING", replace(residuals.TESTING, fresh=1000))
        yield


@pytest.fixture
def all_points(monkeypatch):
    """Test simulated models at as many points as those of users."""
    from calib.training import bounds

    monkeypatch.setattr("calib.training.residuals.TESTING", bounds.TESTING)


@pytest.fixture(scope="session")
def arm() -> calib.PlanarArm:
    """The bundled two_link: shoulder 0 to 90, elbow 15 to 150 deg."""
    return calib.load_arm("two_link")


@pytest.fixture(scope="session")
def run() -> Program:
    return run_in_process


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small model of two_link."""
    path = tmp_path_factory.mktemp("models") / "two_link.calib"
    run_in_process.done("train", "two_link", "--size", "10", "-n", "500", "-o", path)
    return path


@pytest.fixture
def file(tmp_path):
    """Write a small log into the test's own folder."""

    def write(content, name="log.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write

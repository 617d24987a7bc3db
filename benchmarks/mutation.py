"""Measure how many faults the tests notice: a seeded sample of mutants, each run on its own.

    pip install mutmut
    python benchmarks/mutation.py --n 300 --seed 1 [--module arm] [-o survivors.txt]

The committed tree is copied to a temporary folder.  There each of the test files below runs
once under coverage, in a process of its own, which tells the lines that it reaches and how
long its tests compute; tests slower than --slow seconds are left out.  A mutant then runs
the tests that reach its statement, those that are most about its module first, until the
first failure, or as many as fit into --budget seconds of computing.

It is killed if a test fails or the interpreter dies, timed out if it computes for more than
three times as long as its tests usually do and 20 s more, and survived otherwise: also if no
test reaches it, and if it changes nothing that can be observed.  Three unchanged modules are
run in the same way before; all must survive.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import io
import os
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mutants import Changed, Mutant, forked, mutants

ROOT = Path(__file__).parents[1]
MODULES = {
    "arm": "calib/arm/*.py",
    "maps": "calib/maps/*.py",
    "links": "calib/maps/links.py",
    "readouts": "calib/inverse/*.py",
    "adaptation": "calib/change/*.py",
}
TESTS = """
    adaptation adapting arm bad_urdf bounds branches correct correction density dsom gng gp inverse
    lattice linked links local map neighbourhood newton online online_adaptation path plane reach
    redundant refining robots schedule selection servo solver som support teacher trend urdf
"""
"""The test files that are about these modules; the others would hardly kill more."""

PRELOADED = """
    coverage hypothesis numpy pinocchio pytest rich safetensors.numpy scipy.linalg
    scipy.ndimage scipy.optimize scipy.sparse.csgraph scipy.spatial threadpoolctl typer yourdfpy
"""
"""What mutants share; not polars, whose threads do not survive a fork."""

CONTROLS = 3
"""Unchanged modules that must survive before any mutant is judged."""


@dataclass(frozen=True)
class Reach:
    """What a test file does: the computing time of its tests [s], the lines that it reaches."""

    tests: dict[str, float]
    lines: dict[str, frozenset[int]]

    @property
    def seconds(self) -> float:
        return sum(self.tests.values())

    @property
    def total(self) -> int:
        return sum(map(len, self.lines.values()))


@dataclass(frozen=True)
class Verdict:
    """How a mutant ended."""

    mutant: Mutant
    outcome: str
    by: str = ""
    seconds: float = 0.0
    tests: tuple[str, ...] = ()


class TooSlow(BaseException):
    """A test computes for longer than a run of many mutants can afford."""


class Selection:
    """A pytest plugin: which tests run, in what order, for how long, and the first failure."""

    def __init__(self, known: dict[str, float] | None = None, limit: float = 0.0) -> None:
        self.known, self.limit = known, limit
        self.passed: dict[str, float] = {}
        self.by = ""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        known = self.known
        if known is not None:
            order = {item.path: at for at, item in reversed(list(enumerate(items)))}
            items[:] = [item for item in items if item.nodeid in known]
            items.sort(key=lambda item: (order[item.path], known[item.nodeid]))

    def pytest_runtest_logstart(self) -> None:
        self.began = time.process_time()
        if self.limit:
            signal.signal(signal.SIGPROF, _too_slow)
            signal.setitimer(signal.ITIMER_PROF, self.limit)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.by = self.by or report.nodeid
            self.passed.pop(report.nodeid, None)
        elif report.when == "call" and report.passed:
            self.passed[report.nodeid] = time.process_time() - self.began

    def pytest_runtest_logfinish(self) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0)

    def pytest_collectreport(self, report: Any) -> None:
        self.by = self.by or (f"import of {report.nodeid}" if report.failed else "")


def _too_slow(*_: object) -> None:
    raise TooSlow


def tested(root: Path, files: Sequence[str], selection: Selection, *options: str) -> int:
    """Run test files in this order; pytest's exit code."""
    import hypothesis
    import pytest

    hypothesis.settings.register_profile("load", deadline=None, derandomize=True, database=None)
    hypothesis.settings.load_profile("load")
    os.chdir(root)
    sys.path.insert(0, str(root))
    options = (*options, "-q", "-p", "no:cacheprovider", f"--rootdir={root}")
    return int(pytest.main([*options, *(f"tests/{name}" for name in files)], plugins=[selection]))


def reach(root: Path, file: str, paths: Sequence[str], slow: float, log: Path) -> Reach | None:
    """What a test file reaches, without the tests that fail or are slow as they are."""

    def task() -> dict[str, Any]:
        import coverage

        sys.path.insert(0, str(root))
        for path in paths:
            importlib.import_module(".".join(Path(path).with_suffix("").parts))
        watch = coverage.Coverage(data_file=None, include=[str(root / path) for path in paths])
        watch.start()
        selection = Selection(limit=slow)
        tested(root, [file], selection)
        watch.stop()
        data = watch.get_data()
        lines = {path: data.lines(str(root / path)) or [] for path in paths}
        return {"tests": selection.passed, "lines": lines}

    _, answer = forked(task, log, cpu=600)
    if answer is None or not answer.get("tests"):
        return None
    lines = {path: frozenset(numbers) for path, numbers in answer["lines"].items() if numbers}
    return Reach(answer["tests"], lines)


def chosen(mutant: Mutant, reaches: dict[str, Reach], budget: float) -> dict[str, dict[str, float]]:
    """Tests of a mutant by file, the most specific file first, with their times [s]."""
    span = range(mutant.lines[0], mutant.lines[1] + 1)

    def specific(name: str) -> float:
        return len(reaches[name].lines[mutant.path]) / reaches[name].total

    able = [name for name, reach in reaches.items() if mutant.path in reach.lines]
    hit = [name for name in able if not reaches[name].lines[mutant.path].isdisjoint(span)]
    tests: dict[str, dict[str, float]] = {}
    # what runs on import alone is reached by all that reach the module
    for name in sorted(hit or able, key=specific, reverse=True):
        for test, seconds in sorted(reaches[name].tests.items(), key=lambda item: item[1]):
            budget -= seconds
            if budget > 0.0:
                tests.setdefault(name, {})[test] = seconds
    return tests


def judged(root: Path, mutant: Mutant, reaches: dict[str, Reach], budget: float) -> Verdict:
    """Run the tests of a mutant."""
    tests = chosen(mutant, reaches, budget)
    files = list(tests)
    if not files:
        return Verdict(mutant, "survived", "no test reaches it")
    known = {test: took for name in files for test, took in tests[name].items()}
    seconds = sum(known.values())

    def task() -> dict[str, Any]:
        sys.meta_path.insert(0, Changed(root, mutant))
        selection = Selection(known)
        code = tested(root, files, selection, "-x")
        return {"code": code, "by": selection.by, "seconds": time.process_time()}

    died, answer = forked(task, root / f"mutant.{os.getpid()}.log", cpu=3 * seconds + 20)
    if died:
        outcome = "timeout" if died in (signal.SIGXCPU, signal.SIGKILL) else "killed"
        return Verdict(mutant, outcome, signal.Signals(died).name, tests=tuple(files))
    outcome = "survived" if answer["code"] == 0 else "killed"
    return Verdict(mutant, outcome, answer["by"], answer.get("seconds", 0.0), tuple(files))


def copied(root: Path) -> None:
    """Copy the committed tree, laid out so that it can be imported in place."""
    archive = subprocess.run(
        ["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(root, filter="data")
    (root / "calib_cli").symlink_to("cli")
    (root / "calib" / "_robots").symlink_to(Path("..") / "robots")


def prepared() -> None:
    """Import what mutants share, which is everything but calib and its tests."""
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))
    for name in PRELOADED.split():
        importlib.import_module(name)
    loaded = sorted(name for name in sys.modules if name.split(".")[0] == "calib")
    if loaded:
        raise SystemExit(f"these modules would not be changed: {', '.join(loaded)}")


def group(path: str) -> str:
    """The name of the module group of a file."""
    return next(name for name, glob in MODULES.items() if Path(path).match(glob))


def table(verdicts: Sequence[Verdict], population: dict[str, int]) -> Iterator[str]:
    """One line per module group, and their sum."""
    heads = ("of", "mutants", "killed", "timeout", "survived", "score")
    yield f"{'module':<12}" + "".join(f"{head:>10}" for head in heads)
    for name in [*population, "all"]:
        own = [v.outcome for v in verdicts if name in (group(v.mutant.path), "all")]
        if own:
            killed, late, left = map(own.count, ("killed", "timeout", "survived"))
            of = population.get(name, sum(population.values()))
            counts = "".join(f"{count:>10}" for count in (of, len(own), killed, late, left))
            yield f"{name:<12}{counts}{(killed + late) / len(own):>10.1%}"


def run(root: Path, options: argparse.Namespace) -> None:
    """Measure in a folder."""
    copied(root)
    groups = options.module or list(MODULES)
    files = {name: sorted(map(str, _glob(root, MODULES[name]))) for name in groups}
    paths = [path for name in groups for path in files[name]]
    makers = [(group(path), maker) for path in paths for maker in mutants(root, path)]
    population = {name: sum(own == name for own, _ in makers) for name in groups}
    print(f"{len(makers)} mutants of {len(paths)} files", file=sys.stderr)

    reaches = {}
    for name in options.tests.split():
        file = root / "tests" / f"test_{name}.py"
        if file.exists():
            found = reach(root, file.name, paths, options.slow, root / "reach.log")
            say = f"{len(found.tests)} tests, {found.seconds:.1f} s" if found else "no test"
            print(f"  {file.name}: {say}", file=sys.stderr)
            if found and found.total:
                reaches[file.name] = found

    rng = np.random.default_rng(options.seed)
    order = rng.permutation(len(makers))
    for at in rng.permutation(len(paths))[:CONTROLS]:
        text = (root / paths[at]).read_text(encoding="utf-8")
        same = judged(root, Mutant(paths[at], 1, (1, 10**6), text), reaches, options.budget)
        if same.outcome != "survived":
            raise SystemExit(f"{paths[at]} unchanged is {same.outcome}: {same.by}")

    verdicts: list[Verdict] = []
    drawn: set[Mutant] = set()
    for at in order:
        mutant = makers[at][1]()
        # some operators make the same text twice, or no change
        if mutant in drawn or not mutant.diff(root):
            continue
        drawn.add(mutant)
        verdicts.append(judged(root, mutant, reaches, options.budget))
        said = f"{verdicts[-1].outcome:9} {mutant.path}:{mutant.line} {verdicts[-1].by}"
        print(f"{len(verdicts):4} {said}", file=sys.stderr)
        if len(verdicts) == options.n:
            break

    print("\n".join(table(verdicts, population)))
    if options.output:
        left = [v for v in verdicts if v.outcome == "survived"]
        options.output.write_text("\n\n".join(told(root, v) for v in left), encoding="utf-8")


def _glob(root: Path, pattern: str) -> Iterator[Path]:
    found = (path.relative_to(root) for path in root.glob(pattern))
    return (path for path in found if path.name != "__init__.py")


def told(root: Path, verdict: Verdict) -> str:
    """A verdict for people."""
    head = f"{verdict.mutant.path}:{verdict.mutant.line} {verdict.outcome} {verdict.by}".rstrip()
    return f"{head}\n{verdict.mutant.diff(root)}\nran: {' '.join(verdict.tests)}"


def main() -> None:
    """Draw, run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--n", type=int, default=300, help="mutants to draw")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--module", choices=MODULES, action="append", help="repeatable")
    parser.add_argument("--tests", default=TESTS, help="test files, without test_ and .py")
    parser.add_argument("--budget", type=float, default=15.0, help="computing per mutant [s]")
    parser.add_argument("--slow", type=float, default=2.5, help="tests left out are slower [s]")
    parser.add_argument("-o", "--output", type=Path, help="survivors and their diffs")
    options = parser.parse_args()
    if importlib.util.find_spec("mutmut") is None:
        raise SystemExit(
            "the mutants are made by mutmut, which is not installed: pip install mutmut"
        )
    prepared()
    folder = Path(tempfile.mkdtemp(prefix="calib-mutation-"))
    try:
        run(folder, options)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()

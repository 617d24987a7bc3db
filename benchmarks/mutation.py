"""Measure how many faults the tests notice: mutmut in a copy of the committed tree.

    pip install mutmut
    python benchmarks/mutation.py calib/maps/links.py --tests test_links test_linked

Prints mutmut's counts and its survivors, and the folder in which `mutmut show NAME` tells each.
"""

from __future__ import annotations

import argparse
import importlib.util
import io
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
BESIDE = ("cli", "calib_cli", "robots", "docs", "examples", "benchmarks", "README.md")
"""What tests need beside the package that is changed."""


def copied(folder: Path, modules: list[str], tests: list[str]) -> None:
    """Copy the committed tree, laid out so that it can be imported in place, and tell mutmut."""
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as tar:
        tar.extractall(folder, filter="data")
    # pyproject maps these two; mutmut imports from the folder as it is
    (folder / "calib_cli").symlink_to("cli")
    (folder / "calib" / "_robots").symlink_to(Path("..") / "robots")
    files = [f"tests/{name}.py" for name in tests]
    with (folder / "pyproject.toml").open("a") as settings:
        settings.write(
            f'\n[tool.mutmut]\nsource_paths = ["calib"]\nonly_mutate = {modules}\n'
            f"also_copy = {list(BESIDE)}\npytest_add_cli_args_test_selection = {files}\n"
        )


def main() -> int:
    """Run; return mutmut's exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("modules", nargs="+", help="files or patterns, such as calib/maps/*.py")
    parser.add_argument("--tests", nargs="+", required=True, help="test files, without .py")
    options = parser.parse_args()
    if importlib.util.find_spec("mutmut") is None:
        raise SystemExit("mutants are made and judged by mutmut: pip install mutmut")
    folder = Path(tempfile.mkdtemp(prefix="calib-mutation-"))
    copied(folder, options.modules, options.tests)
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    mutmut = [sys.executable, "-m", "mutmut"]
    done = subprocess.run(
        [*mutmut, "run", "--max-children", "1"],
        cwd=folder, env={**os.environ, **one_thread}, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    # its spinner rewrites one line
    said = done.stdout.replace("\r", "\n").splitlines()
    print("\n".join(said[-3:]), flush=True)
    if done.returncode == 0:
        subprocess.run([*mutmut, "results"], cwd=folder, check=False)
    print(f"cd {folder}; mutmut show NAME")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())

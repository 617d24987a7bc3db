"""Check what an sdist and a wheel hold: python .ci/contents.py dist/*."""

from __future__ import annotations

import sys
import tarfile
import zipfile
from email.parser import Parser
from pathlib import Path

TREES = (".ci", "benchmarks", "calib", "cli", "docs", "examples", "robots", "tests")
FILES = ("CHANGELOG.md", "CITATION.cff", "LICENSE", "PKG-INFO", "README.md", "pyproject.toml")


def main() -> None:
    """Check every file that is named on the command line."""
    for path in map(Path, sys.argv[1:]):
        if path.suffix == ".whl":
            check_wheel(path)
        else:
            check_sdist(path)
        print(f"{path.name}: complete, {path.stat().st_size / 1e6:.2f} MB")


def check_wheel(path: Path) -> None:
    """Only the two packages, their licence, and metadata that an index can show."""
    with zipfile.ZipFile(path) as wheel:
        names = wheel.namelist()
        (metadata,) = (n for n in names if n.endswith(".dist-info/METADATA"))
        fields = Parser().parsestr(wheel.read(metadata).decode())
    tops = {name.split("/")[0] for name in names}
    expect(tops == {"calib", "calib_cli", metadata.split("/")[0]}, path, f"top folders {tops}")
    expect(any(n.endswith("licenses/LICENSE") for n in names), path, "a licence")
    for key in ("Name", "Version", "Summary", "Requires-Python", "License-Expression", "Author"):
        expect(bool(fields[key]), path, f"the field {key}")
    expect(fields["Description-Content-Type"] == "text/markdown", path, "a README in Markdown")
    expect(len(fields.get_payload()) > 1000, path, "the README's text")
    expect(fields["Project-URL"] is None, path, "no address: the project has none")


def check_sdist(path: Path) -> None:
    """Everything that is needed to build, test and read, and nothing compiled."""
    with tarfile.open(path) as sdist:
        names = {n.partition("/")[2] for n in sdist.getnames()}
    for tree in TREES:
        count = sum(name.startswith(f"{tree}/") for name in names)
        expect(count > 1, path, f"the folder {tree}")
    for name in FILES:
        expect(name in names, path, name)
    expect(
        not any("__pycache__" in name or name.endswith(".pyc") for name in names), path, "no pyc"
    )


def expect(true: bool, path: Path, what: str) -> None:
    """End the program if something is not so."""
    if not true:
        sys.exit(f"{path.name}: expected {what}")


if __name__ == "__main__":
    main()

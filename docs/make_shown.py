"""Write what the commands of the manual print now into its pages.

python docs/make_shown.py docs/drift.md docs/apply.md     # look at the difference before it is kept

A block that shows all lines gets all lines; one with "..." the lines most like those it shows.
"""

from __future__ import annotations

import sys
import tempfile
from difflib import get_close_matches
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / folder) for folder in ("tests", "tests/project", "benchmarks")]


def renewed(shown: list[str], printed: list[str]) -> list[str]:
    """Return what a page should show: all lines, or those most like the ones that it chose."""
    if not [line for line in shown if line.strip() not in ("", "...")]:
        return shown
    if not any(line.strip() == "..." for line in shown):
        return printed
    new: list[str] = []
    for line in shown:
        if line.strip() in ("", "..."):
            new.append(line)
        elif close := get_close_matches(line, printed, n=1, cutoff=0.5):
            new.append(close[0])
    return new


def page_now(path: Path) -> str:
    """Return a page with what its commands print now, in a folder with a reader's files."""
    import test_docs
    from conftest import run_in_process
    from pages import blocks, check, commands

    text = path.read_text(encoding="utf-8")
    test_docs.needed(text)
    for line in test_docs.EARLIER.get(str(path.relative_to(ROOT)), ()):
        run_in_process(line)
    names: dict[str, object] = {}
    for block in blocks(text):
        if block.skipped or block.remark.startswith("Run by the tests against"):
            continue
        if block.language == "python":
            exec(compile(block.text, path.name, "exec"), names)  # noqa: S102
        elif block.language == "console":
            new = block.text
            for command in commands(block):
                if command.words[0] == "printf":
                    check(command)
                    continue
                done = run_in_process(*command.words[1:])
                printed = [*done.out.splitlines(), *done.err.splitlines()]
                before, after = command.shown, renewed(command.shown, printed)
                if before and before != after:
                    new = new.replace("\n".join(before), "\n".join(after), 1)
            text = text.replace(block.text, new, 1)
    return text


def main(names: list[str]) -> None:
    """Renew the pages named."""
    import test_docs

    start = Path.cwd()
    for name in names:
        with tempfile.TemporaryDirectory() as made, pytest.MonkeyPatch.context() as patch:
            filled = getattr(test_docs.folder, "__wrapped__", None) or test_docs.folder
            filled(Path(made), patch)
            text = page_now((start / name).resolve())
        (start / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

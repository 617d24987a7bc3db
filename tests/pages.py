"""Pages of the manual: their blocks, how they run, where their links lead."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import run_in_process

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_NUMBER = re.compile(r"<?[-+]?\d[\d,]*(\.\d+)?(e[-+]?\d+)?")
_TIME = re.compile(r"\s?(s|ms|us|min)\b")
TOLERANCE = 0.05
"""Share by which a figure on a page may differ: other processors round differently."""
ROUNDING = 1e-3
"""What is below differs from one processor to the next."""
_EXIT = re.compile(r"\s+# exit code (\d+)$")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, and the emphasised line above it, if any."""

    language: str
    text: str
    remark: str

    @property
    def skipped(self) -> bool:
        """Whether the page says that it is not run."""
        return self.remark.startswith("Not run by the tests: ")


@dataclass(frozen=True)
class Command:
    """A line that is typed, the exit code that the page promises, and what it shows."""

    words: list[str]
    code: int
    shown: list[str]


def blocks(text: str) -> Iterator[Block]:
    """Yield the fenced blocks of a page in order."""
    for found in _FENCE.finditer(text):
        above = text[: found.start()].rstrip().rsplit("\n\n", 1)[-1]
        remark = " ".join(above.split()).strip("*") if above.startswith("*") else ""
        yield Block(found[1], found[2], remark)


def commands(block: Block) -> Iterator[Command]:
    """Yield what a console block types, and the lines that it shows after each."""
    typed, shown = "", list[str]()
    for line in [*block.text.replace("\\\n", " ").splitlines(), "$ end"]:
        if not line.startswith("$ "):
            shown.append(line)
            continue
        if typed:
            promised = _EXIT.search(typed) or (0, 0)
            yield Command(shlex.split(typed, comments=True), int(promised[1]), shown)
        typed, shown = line[2:], []


def run_page(page: Path, names: dict[str, object]) -> None:
    """Run the blocks of a page in order, in this folder and with one set of Python names."""
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.language == "python" and not block.skipped:
            exec(compile(block.text, page.name, "exec"), names)
        elif block.language == "console" and not block.skipped:
            for command in commands(block):
                check(command)


def check(command: Command) -> None:
    """Run a command of a page and compare its exit code and what it printed, but for timings."""
    if command.words[0] == "printf":  # a page that makes a small file
        text, _, name = command.words[1:]
        Path(name).write_text(text.replace("\\n", "\n"))
        return
    assert command.words[0] == "calib", f"only calib is run here: {command.words}"
    outcome = run_in_process(*command.words[1:])
    said = f"$ {shlex.join(command.words)}\n{outcome.out}{outcome.err}"
    assert outcome.code == command.code, said
    printed = [*outcome.out.splitlines(), *outcome.err.splitlines()]
    wrong = differing(command.shown, printed)
    assert not wrong, f"{said}\ndiffers from the page: {wrong}"


def differing(shown: list[str], printed: list[str]) -> list[str]:
    """Return the lines of a page that no printed line is like, and printed ones that it hides.

    `...` stands for any lines, or for any words within a line, of which no number counts then.
    Numbers agree to within `TOLERANCE`; timings do not count: numbers with a unit of time, and the
    last column below "seconds". Nor does it matter how columns are spaced.
    """
    timed = any(line.split()[-1:] == ["seconds"] for line in printed)
    wanted = [line for line in shown if line.strip() not in ("", "...")]
    wrong = []
    for line in wanted:
        alike = [other for other in printed if _fits(line, other)]
        figures = pytest.approx(_figures(line, timed=timed), rel=TOLERANCE, abs=ROUNDING)
        same = [other for other in alike if _figures(other, timed=timed) == figures]
        if not same and not ("..." in line and alike):
            wrong.append(line)
    if shown and not any(line.strip() == "..." for line in shown):
        others = [line for line in printed if line.strip()]
        wrong += [f"unseen: {o}" for o in others if not any(_fits(line, o) for line in wanted)]
    return wrong


def _figures(line: str, *, timed: bool) -> list[float]:
    """Return the numbers of a line that are no timings."""
    found = [m for m in _NUMBER.finditer(line) if not _TIME.match(line, m.end())]
    values = [float(m[0].lstrip("<").replace(",", "")) for m in found]
    return values[:-1] if timed and len(line.split()) > 3 else values


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub gives the headings of a page."""
    found: set[str] = set()
    outside = _FENCE.sub("", text)
    for heading in re.findall(r"^#{1,6} (.+)$", outside, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
        found.add(re.sub(r"[^\w\- ]", "", plain.strip().lower()).replace(" ", "-"))
    return found


def links(text: str) -> list[str]:
    """Return the targets of a page's links and pictures that stay within the repository."""
    outside = _FENCE.sub("", text)
    outside = re.sub(r"(?m)^    .*$", "", outside)
    outside = re.sub(r"`[^`\n]*`", "`code`", outside)
    return re.findall(r"\]\((?!https?:|mailto:)([^)\s]+)\)", outside)


def _masked(line: str) -> str:
    return " ".join(_NUMBER.sub("#", line).split())


def _fits(pattern: str, line: str) -> bool:
    """Whether a line is like a page's, but for its numbers."""
    words = re.escape(_masked(pattern)).replace(r"\.\.\.", ".*")
    return re.fullmatch(words, _masked(line)) is not None

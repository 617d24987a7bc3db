"""What a command may print: exit code, lines of errors and notes, one JSON document."""

from __future__ import annotations

import json
import unicodedata

from .guard import LONGEST, Violation

CODES = (0, 1, 2, 3)
_TOLD = (
    "not all values are numbers, no answer",
    "left out of the path",
)  # of a batch, the others answered


def judge_output(args: tuple[str, ...], code: int, out: str, err: str) -> None:
    """Check the exit code, what is said, and the JSON document.

    Raises
    ------
    Violation
        If one of them is not as the README says.
    """
    if code not in CODES:
        raise Violation(f"exit code {code}: {err[-500:]}")
    for text in (out, err):
        if "Traceback" in text or "internal error" in text or "Warning" in text:
            raise Violation(text[-1500:])
        odd = {c for c in text if unicodedata.category(c) in ("Cc", "Zl", "Zp") and c not in "\n"}
        if odd:
            raise Violation(f"{sorted(odd)!r} printed: {text[:300]!r}")
    lines = err.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    if any(len(line) > LONGEST for line in lines):
        raise Violation(f"a line of {max(map(len, lines))} characters")
    others = [line for line in lines if not line.startswith("note: ")]
    asked = "--json" in args and "--" not in args
    if asked and code in (1, 2) and errors:  # the error is the document
        try:
            out = "" if set(json.loads(out, parse_constant=_no_constant)) == {"error"} else out
        except ValueError as error:
            raise Violation(f"no JSON error ({error}): {out[:300]!r}") from None
    if code == 2 and (len(others) != 1 or len(errors) != 1 or out):
        raise Violation(f"wrong usage told in other than one line: {out[:200]!r} {err[:500]!r}")
    if code == 1 and not (lines and len(errors) <= 1):
        raise Violation(f"an error told in other than one line: {err[:500]!r}")
    if code == 1 and not errors and not any(words in err for words in _TOLD):
        raise Violation(f"exit code 1 without an error: {err[:500]!r}")
    if code in (0, 3) and errors:
        raise Violation(f"an error and exit code {code}: {err[:300]!r}")
    if code == 3 and not lines and not out:
        raise Violation("no answer and no word")
    helps = {"--help", "--version", "-h"} & set(args)
    if "--json" in args and "--" not in args and code in (0, 3) and not helps:
        try:
            json.loads(out, parse_constant=_no_constant)
        except ValueError as error:
            raise Violation(f"no JSON ({error}): {out[:300]!r}") from None


def _no_constant(name: str) -> None:
    raise ValueError(name)

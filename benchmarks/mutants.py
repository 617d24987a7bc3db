"""Mutants: a module with one change by mutmut's operators, and a fork that imports it.

Unlike `mutmut run` these also change decorated functions, properties, and constants of
modules and classes.  Annotations, decorators, imports, docstrings, `__all__`, and calls of
`len` and `isinstance` are left alone.
"""

from __future__ import annotations

import difflib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import resource
import signal
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

MEMORY = 8 << 30
"""Address space of a mutant [bytes]: one that asks for more is killed by its MemoryError."""


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes
    ----------
    path : str
        The file, relative to the tree.
    line : int
        Where the change begins.
    lines : (int, int)
        First and last line of the statement that holds the change.
    source : str
        The changed text of the whole file.
    """

    path: str
    line: int
    lines: tuple[int, int]
    source: str

    def diff(self, root: Path) -> str:
        """The change, as a unified diff without its head; empty if there is none."""
        old = (root / self.path).read_text(encoding="utf-8").splitlines()
        changes = difflib.unified_diff(old, self.source.splitlines(), lineterm="", n=1)
        return "\n".join(list(changes)[2:])


def mutants(root: Path, path: str) -> list[Callable[[], Mutant]]:
    """What makes every mutant of a file, in the order of its text."""
    import libcst as cst
    from libcst.metadata import MetadataWrapper, PositionProvider
    from mutmut.mutation.mutators import mutation_operators

    untouched = (cst.Annotation, cst.Decorator, cst.Import, cst.ImportFrom)

    class Visitor(cst.CSTVisitor):
        METADATA_DEPENDENCIES = (PositionProvider,)

        def __init__(self) -> None:
            super().__init__()
            self.found: list[tuple[Any, Any, int, tuple[int, int]]] = []
            self.statements: list[Any] = []
            self.functions = 0

        def on_visit(self, node: Any) -> bool:
            if isinstance(node, untouched) or is_typing(node):
                return False
            if isinstance(node, cst.SimpleStatementLine | cst.BaseCompoundStatement):
                self.statements.append(node)
            self.functions += isinstance(node, cst.FunctionDef)
            # outside of functions only constants: a changed type alias changes nothing
            if self.functions or isinstance(node, cst.BaseNumber | cst.BaseString | cst.Name):
                self.change(node)
            return True

        def on_leave(self, node: Any) -> None:
            if self.statements and self.statements[-1] is node:
                self.statements.pop()
            self.functions -= isinstance(node, cst.FunctionDef)

        def change(self, node: Any) -> None:
            for kind, operator in mutation_operators:
                for new in operator(node) if isinstance(node, kind) else ():
                    home = self.get_metadata(PositionProvider, self.statements[-1])
                    # not every operator has a position of its own
                    at = self.get_metadata(PositionProvider, node, home).start.line
                    self.found.append((node, new, at, (home.start.line, home.end.line)))

    def is_typing(node: Any) -> bool:
        match node:
            case cst.If(test=cst.Name(value="TYPE_CHECKING")):
                return True
            case cst.Assign(targets=[cst.AssignTarget(target=cst.Name(value="__all__"))]):
                return True
            case cst.Call(func=cst.Name(value="len" | "isinstance")):
                return True
        return False

    wrapper = MetadataWrapper(cst.parse_module((root / path).read_text(encoding="utf-8")))
    visitor = Visitor()
    wrapper.visit(visitor)

    def changed(old: Any, new: Any, line: int, lines: tuple[int, int]) -> Mutant:
        return Mutant(path, line, lines, wrapper.module.deep_replace(old, new).code)

    return [partial(changed, *found) for found in visitor.found]


class Changed(importlib.abc.MetaPathFinder):
    """Imports one module of a tree from a changed text instead of its file."""

    def __init__(self, root: Path, mutant: Mutant) -> None:
        self.name = ".".join(Path(mutant.path).with_suffix("").parts)
        self.loader = _Loader(self.name, str(root / mutant.path))
        self.loader.source = mutant.source

    def find_spec(self, name: str, *_: Any) -> Any:
        """The module's own loader for its name, None for any other."""
        if name != self.name:
            return None
        return importlib.util.spec_from_file_location(name, self.loader.path, loader=self.loader)


class _Loader(importlib.machinery.SourceFileLoader):
    source = ""

    def get_code(self, _: str) -> Any:
        return compile(self.source, self.path, "exec", dont_inherit=True)


def forked(task: Callable[[], dict[str, Any]], log: Path, cpu: float) -> tuple[int, Any]:
    """Run a task in a fork of this process, within `cpu` seconds of computing.

    Returns
    -------
    died : int
        The signal that ended it, or 0.
    answer : dict or None
        What it returned, through JSON; `{"code": 1, "by": ...}` where it raised.
    """
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        resource.setrlimit(resource.RLIMIT_CPU, (int(cpu) + 1, int(cpu) + 3))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        sink = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
        try:
            answer = task()
        except BaseException as error:
            answer = {"code": 1, "by": f"{type(error).__name__} outside of the tests"}
        with os.fdopen(write, "w") as pipe:
            json.dump(answer, pipe)
        os._exit(0)
    os.close(write)
    # what sleeps instead of computing is ended by the clock
    signal.signal(signal.SIGALRM, lambda *_: os.kill(pid, signal.SIGXCPU))
    signal.alarm(int(20 * cpu))
    with os.fdopen(read) as pipe:
        text = pipe.read()
    status = os.waitpid(pid, 0)[1]
    signal.alarm(0)
    return (os.WTERMSIG(status), None) if os.WIFSIGNALED(status) else (0, json.loads(text))

"""Errors: the root of all exceptions for a wrong set-up (an expected failure is a `Failure`), and faults
in files with their places.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from textwrap import indent
from typing import Generic, Literal, NoReturn, TypeAlias, TypeVar


class PicktreeError(Exception):
    """Bad input or a broken set-up. The text is for the user: place, problem, and remedy."""


Location: TypeAlias = tuple[str | int, ...]
Severity: TypeAlias = Literal["error", "warning"]


@dataclass(frozen=True, slots=True, order=True)
class Mark:
    """A place in a file; line and column count from 1, and are 0 where the text is not written in a file."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file

    def describe(self, file: str) -> str:
        """Describe the line for a reader of that file: `line 12`, or `line 12 of common.yaml`."""
        return f"line {self.line}" + (f" of {self.file}" if self.file != file else "")


def _no_code() -> NoReturn:
    raise TypeError("every fault has a code, and every code a page in files/pages")


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """Fault at a place in a file. `where` is the dotted path of the value, or the node's path in the tree.
    `hint` is the remedy, `code` names the page that explains the fault (P104)."""

    mark: Mark
    where: str
    message: str
    hint: str = ""
    code: str = field(default_factory=_no_code)
    severity: Severity = "error"
    detail: str = ""
    """Lines printed below the fault, such as the traceback of a plug-in that cannot be imported."""

    def __str__(self) -> str:
        trail = f"{self.where}: " if self.where else ""
        line = f"{self.mark}: {trail}{self.message}" + (f" ({self.hint})" if self.hint else "")
        return f"{line}\n{indent(self.detail, '    ')}" if self.detail else line


MAX_FAULTS = 100
"""Maximum number of faults reported for one file."""
SPOILING_CODES = ("P113", "P116", "P120")
"""Faults of form that spoil the value at their place: further faults of that value only follow from them."""


def too_many(mark: Mark) -> Diagnostic:
    """Return one fault in place of all faults beyond MAX_FAULTS; `mark` is the place of the first of them."""
    return Diagnostic(mark, "", f"more than {MAX_FAULTS} faults; the rest is not shown", code="P126")


class FileError(PicktreeError):
    """Everything that is wrong with a file, in the order of the file; one line per fault."""

    def __init__(self, faults: Iterable[Diagnostic]) -> None:
        self.faults = tuple(sorted(dict.fromkeys(faults), key=lambda fault: fault.mark))
        super().__init__("\n".join(map(str, self.faults)))

    def __reduce__(self) -> tuple[type[FileError], tuple[tuple[Diagnostic, ...]]]:
        return type(self), (self.faults,)


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class CheckedFile(Generic[T]):
    """Result of checking a file: its value, None when there are errors, and all faults."""

    value: T | None
    faults: tuple[Diagnostic, ...]

    def required(self) -> T:
        """Return the value. Raises FileError with all faults when there are errors."""
        if self.value is None:
            raise FileError(self.faults)
        return self.value


def where(loc: Iterable[str | int]) -> str:
    """`("trees", "Main", 0)` as people read it: `trees.Main[0]`."""
    text = ""
    for part in loc:
        name = part if isinstance(part, int) or len(part) <= 60 else part[:57] + "..."
        text += f"[{name}]" if isinstance(name, int) else f".{name}" if text else name
    return text

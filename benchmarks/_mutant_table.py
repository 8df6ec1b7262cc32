"""Results of a mutation run: kept between runs, argued about, and as a table."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _campaign import wilson
from _mutant_operators import Mutant

TARGET = 0.9
"""Share of the mutants that are no equivalents which the tests must notice."""
NOTICED = ("killed", "timed out")
KEY = ("file", "function", "operator", "line", "mutant")


@dataclass(frozen=True, slots=True)
class Result:
    """How one mutant ended."""

    mutant: Mutant
    room: str
    verdict: str
    """killed, timed out, survived or equivalent."""
    test: str = ""
    """The test that noticed it."""
    message: str = ""
    ran: int = 0
    """Tests that were selected for it."""
    left: int = 0
    """Tests that run its place, too, but were too dear."""
    argument: str = ""
    """Why it changes nothing, as somebody has written down."""

    @property
    def word(self) -> str:
        """What there is to say of it."""
        if self.argument:
            return self.argument
        if self.verdict in NOTICED:
            return f"{self.verdict} by {self.test}: {self.message}"
        if not self.ran:
            return "no test runs it"
        rest = f"; {self.left} more were too dear" if self.left else ""
        return f"no red test of {self.ran} that run{'s' if self.ran == 1 else ''} it{rest}"


class Arguments:
    """Why some mutants change nothing that matters, from a file that people write."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._because: dict[tuple[str, ...], str] = {}
        for entry in tomllib.loads(path.read_text(encoding="utf-8")).get("equivalent", []):
            because = " ".join(str(entry.get("because", "")).split())
            if set(entry) != {*KEY, "because"} or not because:
                raise ValueError(f"{path.name}: an entry needs {', '.join(KEY)} and because: {entry}")
            self._because[tuple(entry[name] for name in KEY)] = because

    def of(self, mutant: Mutant) -> str:
        """The argument for a mutant; empty when there is none."""
        return self._because.get(mutant.key, "")

    def stale(self, found: Iterable[Mutant]) -> list[str]:
        """Entries that fit no mutant any more."""
        known = {mutant.key for mutant in found}
        return [f"{key[0]}, {key[1]}: {key[3]}" for key in self._because if key not in known]


def entry(mutant: Mutant) -> str:
    """The entry of a mutant for that file, but for its argument."""
    lines = "\n".join(f"{name} = '''{value}'''" for name, value in zip(KEY, mutant.key, strict=True))
    return f'[[equivalent]]\n{lines}\nbecause = ""\n'


class Kept:
    """Rows in a file that outlive the process, each good for one state of sources and tests."""

    def __init__(self, path: Path) -> None:
        self._path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self._rows: dict[str, dict[str, Any]] = {}
        for line in lines:
            try:
                row = json.loads(line)
            except ValueError:  # cut off when the process was killed
                continue
            self._rows[row["name"]] = row

    def get(self, name: str) -> dict[str, Any] | None:
        """The last row of a name, of whatever state."""
        return self._rows.get(name)

    def add(self, name: str, state: str, **values: object) -> dict[str, Any]:
        row = {"name": name, "state": state, **values}
        self._rows[name] = row
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        return row

    def values(self, what: str) -> list[Any]:
        return [row[what] for row in self._rows.values() if what in row]


@dataclass(frozen=True, slots=True)
class Line:
    """A row of the table."""

    room: str
    mutants: int
    killed: int
    timed_out: int
    survived: int
    equivalent: int

    @property
    def noticed(self) -> int:
        return self.killed + self.timed_out

    @property
    def judged(self) -> int:
        return self.mutants - self.equivalent

    @property
    def score(self) -> float:
        return self.noticed / self.judged if self.judged else 1.0

    def cells(self) -> tuple[str, ...]:
        low, high = wilson(self.noticed, self.judged)
        counts = (self.mutants, self.killed, self.timed_out, self.survived, self.equivalent)
        rate = f"{100 * self.score:.1f} %" if self.judged else "–"
        return self.room, *map(str, counts), rate, f"{100 * low:.1f} … {100 * high:.1f} %"


HEAD = ("room", "mutants", "killed", "timed out", "survived", "equivalent", "score", "95 % interval")


def table(results: Sequence[Result], rooms: Iterable[str]) -> list[Line]:
    """A line for each room that has mutants, and one for all."""
    lines = [_line(room, [r for r in results if r.room == room]) for room in rooms]
    return [*(line for line in lines if line.mutants), _line("all", results)]


def _line(room: str, results: Sequence[Result]) -> Line:
    counts = Counter(result.verdict for result in results)
    return Line(
        room, len(results), counts["killed"], counts["timed out"], counts["survived"], counts["equivalent"]
    )


def to_text(lines: Sequence[Line], results: Iterable[Result]) -> str:
    """For a terminal: the table, then what survived, with its argument where there is one."""
    rows = [HEAD, *(line.cells() for line in lines)]
    widths = [max(len(row[n]) for row in rows) for n in range(len(HEAD))]
    told = [
        row[0].ljust(widths[0])
        + "".join(f"  {cell:>{w}}" for cell, w in zip(row[1:], widths[1:], strict=True))
        for row in rows
    ]
    for verdict, chosen in _survivors(results):
        told += ["", f"{verdict}:"]
        for result in chosen:
            told += [f"{_place(result.mutant)}: {result.word}", *_change(result.mutant)]
    return "\n".join(told)


def to_page(lines: Sequence[Line], results: Iterable[Result], command: str) -> str:
    """The same in Markdown."""
    told = [
        "# Mutants", "",
        f"What the tests notice of small mistakes in the code, by `{command}`. "
        "[measurements.md](measurements.md) says how it is measured.", "",
        f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}",
        *(f"| {' | '.join(line.cells())} |" for line in lines),
    ]  # fmt: skip
    for verdict, chosen in _survivors(results):
        told += ["", f"## {verdict}"]
        for result in chosen:
            told += ["", f"`{_place(result.mutant)}`: {result.word}"]
            told += ["", "```diff", *_change(result.mutant, ""), "```"]
    return "\n".join(told) + "\n"


def _survivors(results: Iterable[Result]) -> Iterator[tuple[str, list[Result]]]:
    ordered = sorted(results, key=lambda result: result.mutant.place)
    for verdict in ("survived", "equivalent"):
        chosen = [result for result in ordered if result.verdict == verdict]
        if chosen:
            yield verdict.capitalize(), chosen


def _place(mutant: Mutant) -> str:
    return f"{mutant.file}:{mutant.line} {mutant.function or 'module'} ({mutant.operator})"


def _change(mutant: Mutant, indent: str = "    ") -> list[str]:
    return [f"{indent}- {mutant.before}", f"{indent}+ {mutant.after}"]

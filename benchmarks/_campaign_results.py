"""Results of a campaign's finished runs, in its folder, and the forecast that is made of them."""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any, cast

from _dependencies import Dependencies
from picktree.session.environment import revision

REFERENCE_COST = 0.26
"""CPU seconds of the reference on the machine to which the costs in the programs refer."""
FILE = "results.jsonl"
MEASURED = frozenset({"cpu", "cpu_seconds", "wall_seconds", "ms", "folder", "log", "said", "kills"})
"""Values of a row that two runs of one job do not share: the computer's times and places."""
ROOT = f"{Path(__file__).resolve().parent.parent}/"
Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Result:
    """Finished run."""

    job: Mapping[str, Any]
    commit: str
    code: str
    """Digest of the files that the run depended on."""
    cpu: float
    """CPU time of the run, s."""
    reference: float
    """CPU time of the reference when the campaign began, s."""
    row: Row


class Results:
    """File of the finished runs."""

    def __init__(self, folder: Path, reference: float, *, mixed: bool) -> None:
        """`reference`: its CPU time on this machine, s. `mixed`: count results whose files have changed."""
        self._path, self._dependencies = folder / FILE, Dependencies(folder)
        self.reference = reference
        self.others: dict[str, int] = {}
        """Number of results whose files have changed since, by commit."""
        self.costs: defaultdict[str, list[float]] = defaultdict(list)
        """CPU times as multiples of the reference, by kind: the job without its seed."""
        self._found: dict[str, Result] = {}
        self._cut = self._path.exists() and self._path.read_bytes()[-1:] not in (b"", b"\n")
        for result in _read(folder):
            self._learn(result)
            if mixed or self._dependencies.hold(result.code):
                self._found[key(result.job)] = result
            else:
                self.others[result.commit] = self.others.get(result.commit, 0) + 1

    def row(self, job: Any) -> Row | None:
        found = self._found.get(key(plain(job)))
        return {**found.row, "job": found.job} if found else None

    def to_do(self, job: Any) -> bool:
        row = self.row(job)
        return row is None or "crash" in row

    def add(self, job: Any, row: Row, cpu: float, files: Iterable[str]) -> None:
        """Write the result to the disk, whole, at once."""
        code = self._dependencies.add(files)
        result = Result(plain(job), revision(), code, round(cpu, 2), round(self.reference, 3), row)
        line = ("\n" if self._cut else "") + json.dumps(asdict(result), ensure_ascii=False) + "\n"
        with self._path.open("ab", buffering=0) as file:
            file.write(line.encode())
            os.fsync(file.fileno())
        self._cut = False
        self._learn(result)
        self._found[key(result.job)] = result

    def _learn(self, result: Result) -> None:
        if result.cpu:
            self.costs[key(result.job, seed=False)].append(result.cpu / result.reference)


def commits(folder: Path) -> list[str]:
    """Return the commits of the results in a campaign's folder whose files have not changed, oldest first."""
    dependencies = Dependencies(folder)
    return list(dict.fromkeys(each.commit for each in _read(folder) if dependencies.hold(each.code)))


@dataclass(frozen=True, slots=True)
class Repeats:
    """Runs of an old result that were run again later."""

    same: int
    """Number of those that came out the same."""
    again: int
    commits: str
    """Commits with which they were run again."""
    hold: bool
    """Whether no file of theirs has changed since."""


def repeated(folder: Path, commit: str) -> Repeats:
    """Compare the results in a campaign's folder that were made with `commit`, which may be several, with
    later ones of the same jobs: with those of the files as they are, if there are any."""
    dependencies, before, later = Dependencies(folder), dict[str, Result](), dict[str, Result]()
    for each in _read(folder):
        job = key(each.job)
        if each.commit in commit.split(", "):
            before[job] = each
        elif job in before and each.code != before[job].code:
            later[job] = each
    holding = {job: each for job, each in later.items() if dependencies.hold(each.code)}
    taken = holding or later
    same = sum(_told(before[job].row) == _told(each.row) for job, each in taken.items())
    by = ", ".join(dict.fromkeys(each.commit for each in taken.values()))
    return Repeats(same, len(taken), by, bool(holding))


def _read(folder: Path) -> Generator[Result]:
    """Yield the results of a campaign's folder. A line that a kill has cut off is left out."""
    path = folder / FILE
    for line in path.read_bytes().decode(errors="replace").splitlines() if path.exists() else ():
        with suppress(ValueError, TypeError):
            yield Result(**json.loads(line))


def _told(value: Any) -> object:
    """Return a row, or a part of one, without what was measured of the computer."""
    match value:
        case dict():
            row = cast("Row", value)
            return {name: _told(each) for name, each in row.items() if name not in MEASURED}
        case list():
            return [_told(each) for each in cast("list[Any]", value)]
        case _:
            return value


class Forecast:
    """Forecast of CPU times: the median of recorded runs of the same kind, scaled to this machine's speed."""

    def __init__(self, results: Results, cost: float | Callable[[Any], float]) -> None:
        self._results, self._cost = results, cost

    def of(self, job: Any) -> float:
        """Return the CPU time that a job will take, s."""
        known = self._results.costs.get(key(plain(job), seed=False))
        cost = self._cost(job) if callable(self._cost) else self._cost
        return self._results.reference * (median(known) if known else cost / REFERENCE_COST)

    def total(self, jobs: Iterable[Any]) -> float:
        """Return the CPU time of many jobs, s."""
        return sum(self.of(job) for job in jobs)


def plain(job: Any) -> Row:
    """Return the values of a job as JSON has them; files of the checkout by their paths in it."""
    return json.loads(json.dumps(asdict(job), default=str).replace(ROOT, ""))


def key(job: Mapping[str, Any], *, seed: bool = True) -> str:
    return json.dumps({k: v for k, v in job.items() if seed or k != "seed"}, sort_keys=True)

"""Results of a campaign's finished runs, in its folder, and the forecast that is made of them."""

from __future__ import annotations

import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from picktree.session import sources
from picktree.session.environment import revision

REFERENCE_COST = 0.26
"""CPU seconds of the reference on the machine to which the costs in the programs refer."""
FILE = "results.jsonl"
ROOT = Path(__file__).resolve().parent.parent
Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Result:
    """Finished run."""

    job: Mapping[str, Any]
    commit: str
    code: str
    """Digest of the sources with which it was made."""
    cpu: float
    """CPU time of the run, s."""
    reference: float
    """CPU time of the reference when the campaign began, s."""
    row: Row


class Results:
    """File of the finished runs."""

    def __init__(self, folder: Path, reference: float, program: Path, *, mixed: bool) -> None:
        """`reference`: its CPU time on this machine, s. `mixed`: count results of other sources, too."""
        self._path, self.code = folder / FILE, source_digest(program)
        self.reference = reference
        self.others: dict[str, int] = {}
        """Number of results of other sources, by commit."""
        self.costs: defaultdict[str, list[float]] = defaultdict(list)
        """CPU times as multiples of the reference, by kind: the job without its seed."""
        self._found: dict[str, Result] = {}
        self._cut = self._path.exists() and self._path.read_bytes()[-1:] not in (b"", b"\n")
        for result in _read(folder):
            self._learn(result)
            if mixed or result.code == self.code:
                self._found[key(result.job)] = result
            else:
                self.others[result.commit] = self.others.get(result.commit, 0) + 1

    def row(self, job: Any) -> Row | None:
        found = self._found.get(key(plain(job)))
        return {**found.row, "job": found.job} if found else None

    def to_do(self, job: Any) -> bool:
        row = self.row(job)
        return row is None or "crash" in row

    def add(self, job: Any, row: Row, cpu: float) -> None:
        """Write the result to the disk, whole, at once."""
        result = Result(plain(job), revision(), self.code, round(cpu, 2), round(self.reference, 3), row)
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


def source_digest(program: Path) -> str:
    """Return a digest of a campaign's program, the helpers beside it, and all that affects a run."""
    parts = [
        *(ROOT / "benchmarks").glob("_*.py"),
        *(ROOT / "examples").rglob("*.yaml"),
        *(ROOT / "picktree_cell").glob("*.py"),
    ]
    found = hashlib.sha256()
    for file in sorted({program, *parts, *(ROOT / path for path in sources())}):
        found.update(f"{file.name}\0".encode() + file.read_bytes() + b"\0")
    return found.hexdigest()[:12]


def _read(folder: Path) -> Generator[Result]:
    """Yield the results of a campaign's folder. A line that a kill has cut off is left out."""
    path = folder / FILE
    for line in path.read_bytes().decode(errors="replace").splitlines() if path.exists() else ():
        with suppress(ValueError, TypeError):
            yield Result(**json.loads(line))


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
    return json.loads(json.dumps(asdict(job), default=str).replace(f"{ROOT}/", ""))


def key(job: Mapping[str, Any], *, seed: bool = True) -> str:
    return json.dumps({k: v for k, v in job.items() if seed or k != "seed"}, sort_keys=True)

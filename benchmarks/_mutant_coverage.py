"""Which tests run which lines, and what each of them costs: recorded once, kept for each file of tests.

A record of a file of tests is valid until that file, a test module that it imports, or a mutable source that
its tests run changes. Invalid records are made again, folder by folder.
"""

from __future__ import annotations

import ast
import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from _mutant_operators import Mutant, lines_in_functions
from mutant_site.sitecustomize import CONTEXT, RECORDING, write_recording

SITE = Path(__file__).resolve().parent / "mutant_site"
PYTEST = ("-q", "-p", "no:cacheprovider", "--hypothesis-profile=ci")
"""Options of recording and running: hypothesis draws the same examples each time, and keeps none."""
COST_OF_A_FILE = 8.0
"""CPU seconds of recording a file of tests, for the forecast."""


@dataclass(frozen=True, slots=True)
class Test:
    """A test that passes."""

    id: str
    """Node id of pytest."""
    cost: float
    """CPU time of its own while it was recorded, s: up to twice of what it is otherwise."""
    fixtures: tuple[str, ...] = ()
    """Of wider scope than the test."""

    @property
    def file(self) -> str:
        return self.id.split("::")[0]


@dataclass(frozen=True, slots=True)
class Selection:
    """Tests in the order in which they are run."""

    tests: tuple[Test, ...]
    costs: tuple[float, ...]
    """What each is expected to take, CPU s, the shared fixtures that it is the first to use included."""
    left: int
    """Tests that run the place, too, but were too dear together."""


class Suite:
    """The tests of the checkout as they were recorded."""

    def __init__(self, root: Path, folder: Path, sources: Sequence[str]) -> None:
        self._root, self._folder = root, folder
        self._sources = tuple(sources)
        self._digests = {name: digest((root / name).read_bytes()) for name in sources}
        self._kept: dict[str, dict[str, Any]] = {}
        self._tests: dict[str, Test] = {}
        self._fixtures: dict[str, float] = {}
        self._runners: dict[str, dict[int, set[str]]] = {}

    def stale(self) -> list[str]:
        """Files of tests that must be recorded."""
        return [file for file in self._files() if self._read(file) is None]

    def _files(self) -> list[str]:
        found = (self._root / "tests").rglob("test_*.py")
        return sorted(str(file.relative_to(self._root)) for file in found if "node_modules" not in file.parts)

    def _read(self, file: str) -> dict[str, Any] | None:
        """What is kept of a file of tests; None when it is missing or too old."""
        if file in self._kept:
            return self._kept[file]
        path = self._place(file)
        if not path.exists():
            return None
        kept = json.loads(path.read_text(encoding="utf-8"))
        current = {name: self._digests.get(name) for name in kept["sources"]}
        if kept["stamp"] != self._stamp(file) or kept["sources"] != current:
            return None
        self._kept[file] = kept
        return kept

    def _stamp(self, file: str) -> str:
        return digest(stamp(self._root, file), *self._sources)

    def _place(self, file: str) -> Path:
        return self._folder / "tests" / (file.replace("/", ".") + ".json")

    def record(self, files: Sequence[str], workers: int) -> None:
        """Run these files of tests and keep what they run. Raises when pytest cannot run at all."""
        folders = defaultdict[str, list[str]](list)
        for file in files:
            folders[file.rsplit("/", 1)[0]].append(file)
        for folder, own in sorted(folders.items()):
            print(f"  {folder}: {len(own)} files", file=sys.stderr, flush=True)
            self._record(own, workers)

    def _record(self, files: Sequence[str], workers: int) -> None:
        recording = self._folder / "recording"
        shutil.rmtree(recording, ignore_errors=True)
        recording.mkdir(parents=True)
        plan = recording / "plan.json"
        write_recording(plan, recording / "lines", [self._root / name for name in self._sources])
        environment = {**os.environ, RECORDING: str(plan), "PYTHONPATH": f"{SITE.parent}{os.pathsep}{SITE}"}
        environment.pop(CONTEXT, None)
        spread = ["-n", str(workers), "--dist", "loadfile"] if workers > 1 else []
        with (self._folder / "recording.txt").open("a") as output:
            ran = subprocess.run(
                [sys.executable, "-m", "pytest", *PYTEST, "-p", "_mutant_recorder", *spread, *files],
                cwd=self._root, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
            )  # fmt: skip
        if ran.returncode not in (0, 1):
            raise RuntimeError(f"pytest ended with {ran.returncode}; see {output.name}")
        self._keep(files, recording)
        shutil.rmtree(recording)

    def _keep(self, files: Sequence[str], recording: Path) -> None:
        """Sort what was recorded by file of tests."""
        costs, fixtures, bad = dict[str, float](), dict[str, list[str]](), set[str]()
        for part in sorted(recording.glob("tests-*.json")):
            told = json.loads(part.read_text(encoding="utf-8"))
            for name, seconds in told["costs"].items():
                costs[name] = max(seconds, costs.get(name, 0.0))
            fixtures |= told["fixtures"]
            bad |= set(told["bad"])
        lines = _lines(recording, self._root)
        (self._folder / "tests").mkdir(exist_ok=True)
        for file in files:
            tests = [name for name in fixtures if name.split("::")[0] == file]
            used = sorted({fixture for name in tests for fixture in fixtures[name]})
            own = {name: lines[name] for name in (*tests, *used) if name in lines}
            run = sorted({source for sources in own.values() for source in sources})
            kept = {
                "stamp": self._stamp(file),
                "tests": {name: [costs[name], fixtures[name]] for name in tests if name not in bad},
                "bad": sorted(name for name in tests if name in bad),
                "fixtures": {name: costs.get(name, 0.0) for name in used},
                "lines": own,
                "sources": {name: self._digests[name] for name in run},
            }
            path = self._place(file)
            path.with_suffix(".part").write_text(json.dumps(kept), encoding="utf-8")
            path.with_suffix(".part").replace(path)

    def load(self) -> None:
        """Take in what is kept. Lines outside of functions say nothing: they run once, at import."""
        for file in self._files():
            kept = self._read(file)
            if kept is None:
                raise RuntimeError(f"{file} is not recorded")
            self._fixtures |= kept["fixtures"]
            users = defaultdict[str, list[str]](list)
            for name, (cost, fixtures) in kept["tests"].items():
                self._tests[name] = Test(name, cost, tuple(fixtures))
                users[name].append(name)
                for fixture in fixtures:
                    users[fixture].append(name)
            for context, sources in kept["lines"].items():
                for source, numbers in sources.items():
                    runners = self._runners.setdefault(source, {})
                    for number in numbers:
                        runners.setdefault(number, set()).update(users[context])

    @property
    def size(self) -> int:
        return len(self._tests)

    @property
    def bad(self) -> list[str]:
        """Tests that failed or were skipped, without any mutant: they judge none."""
        return [name for kept in self._kept.values() for name in kept["bad"]]

    def cost(self) -> float:
        """Of all tests once, CPU s."""
        return sum(test.cost for test in self._tests.values()) + sum(self._fixtures.values())

    def select(self, mutant: Mutant, budget: float, without: Iterable[str] = ()) -> Selection:
        """Tests that run the place of a mutant, the cheapest first, as many as `budget` CPU s allow for."""
        near, far = (self._running(mutant.file, lines) - set(without) for lines in (mutant.near, mutant.far))
        ordered = self._ordered(near) if near else []
        if mutant.declares or not near:
            ordered += self._ordered(far - near)
        return self.selection(ordered, budget)

    def selection(self, tests: Sequence[Test], budget: float = math.inf) -> Selection:
        """The first of these tests that `budget` CPU s allow for; one at least, if there is one."""
        spent, costs, done = 0.0, list[float](), set[str]()
        for test in tests:
            cost = test.cost + sum(self._fixtures[name] for name in test.fixtures if name not in done)
            if costs and spent + cost > budget:
                break
            costs.append(cost)
            done |= set(test.fixtures)
            spent += cost
        return Selection(tuple(tests[: len(costs)]), tuple(costs), len(tests) - len(costs))

    def _running(self, source: str, lines: Iterable[int]) -> set[str]:
        runners = self._runners.get(source, {})
        return set().union(*(runners.get(line, ()) for line in lines))

    def _ordered(self, names: Iterable[str]) -> list[Test]:
        """By cost; tests that share a dear fixture stay together, so that it is made once."""
        groups = defaultdict[tuple[object, ...], list[Test]](list)
        for name in sorted(names):
            test = self._tests[name]
            shared = tuple(fixture for fixture in test.fixtures if self._fixtures[fixture] > 0.05)
            groups[(test.file, shared) if shared else (name,)].append(test)

        def dearness(group: list[Test]) -> float:
            return min(t.cost for t in group) + sum(self._fixtures[name] for name in group[0].fixtures)

        ordered = sorted(groups.values(), key=lambda group: (dearness(group), group[0].id))
        return [test for group in ordered for test in sorted(group, key=lambda test: (test.cost, test.id))]


def _lines(recording: Path, root: Path) -> dict[str, dict[str, list[int]]]:
    """Lines by context and source, of all processes."""
    import coverage

    found = defaultdict[str, dict[str, set[int]]](lambda: defaultdict(set))
    for path in recording.glob("lines.*"):
        data = coverage.CoverageData(str(path))
        data.read()
        for measured in data.measured_files():
            source = str(Path(measured).relative_to(root))
            bodies = _bodies(root / source)
            for line, contexts in data.contexts_by_lineno(measured).items():
                for context in contexts if line in bodies else ():
                    found[context][source].add(line)
    found.pop("", None)
    return {
        context: {source: sorted(numbers) for source, numbers in sorted(sources.items())}
        for context, sources in found.items()
    }


@cache
def _bodies(path: Path) -> frozenset[int]:
    """Lines of a source that are within functions."""
    return lines_in_functions(ast.parse(path.read_text(encoding="utf-8")))


def digest(*parts: bytes | str) -> str:
    """A short hash of all of them."""
    whole = hashlib.sha256()
    for part in parts:
        raw = part.encode() if isinstance(part, str) else part
        whole.update(len(raw).to_bytes(8, "big") + raw)
    return whole.hexdigest()[:20]


@cache
def stamp(root: Path, file: str) -> str:
    """Hash of a file of tests with all of the tests' files that it imports, and with its conftests."""
    seen: set[Path] = set()
    waiting = [root / file]
    while waiting:
        path = waiting.pop()
        if path not in seen:
            seen.add(path)
            waiting += _imported(root, path)
            waiting += [conftest for each in path.parents if (conftest := each / "conftest.py").exists()]
    paths = sorted(seen)
    return digest(*(str(path.relative_to(root)) for path in paths), *(path.read_bytes() for path in paths))


@cache
def _imported(root: Path, path: Path) -> tuple[Path, ...]:
    """Files of the tests that a file of the tests imports."""
    found: list[Path] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom):
            continue
        words = (node.module or "").split(".") if node.module else []
        base = path.parents[node.level - 1] if node.level else root
        if node.level or words[0] == "tests":
            target = base.joinpath(*words)
            found += [target.with_suffix(".py"), *(target / f"{alias.name}.py" for alias in node.names)]
    return tuple(each for each in found if each.exists())

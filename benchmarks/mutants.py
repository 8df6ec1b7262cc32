"""Mutation run: do the tests notice small mistakes in the code that decides?

    python benchmarks/mutants.py                      # 300 mutants; goes on where it stopped
    python benchmarks/mutants.py --only recovery --runs 50 --seed 3
    python benchmarks/mutants.py --markdown mutants.md

A mutant is one small change of one place: `<` for `<=`, `and` for `or`, a constant twice as large, a deleted
statement. Its tests are those that run its line; it is killed when one of them is red or hangs. Exit code 0:
at least 90 % are killed; 1: fewer.

What to do with a survivor: write the test that misses. Where a mutant changes nothing that anybody could
notice, copy its entry from .mutants/survivors.toml into benchmarks/equivalent_mutants.toml and say there why.
The entry stays good when lines move.

1. Which test runs which line is recorded once, by coverage, and kept in .mutants for each file of tests.
2. The sample follows from the seed and from what each place looks like; all places are equally likely.
3. For each mutant a process is forked, which imports the mutated text in place of the file. No file changes.
4. A test counts as red for a mutant only if it is green without one in such a process, too.

The operators are our own, over the standard library's syntax tree: mutmut changes no constants outside of
functions and needs a copy of the package; cosmic-ray's parser loses the functions with a `match` statement.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from _campaign import ROOT
from _mutant_coverage import COST_OF_A_FILE, Selection, Suite, Test, digest, stamp
from _mutant_operators import Mutant, mutants, sample
from _mutant_runs import Job, Outcome, Runner
from _mutant_table import NOTICED, TARGET, Arguments, Kept, Result, entry, table, to_page, to_text

ROOMS: dict[str, dict[str, tuple[str, ...]]] = {
    "skills": {
        "skills/*.py": (),
        "robot/manipulation/object_*.py": (),
        "robot/manipulation/insertion.py": (),
        "robot/manipulation/closed_loop_pushing.py": (),
        "robot/manipulation/held_object.py": (),
    },
    "recovery": {"recovery/*.py": ()},
    "scorer": {f"simulation/{name}.py": () for name in ("scorer", "truth", "physics/contacts")},
    "safety": {
        "robot/control/wrist_wrench.py": (),
        "robot/control/motion_lease.py": (),
        "robot/control/safety_monitor.py": (),
        "robot/control/external_torque.py": (),
        "robot/control/control_loop.py": (),
        "robot/planning/trajectory_gate.py": (),
    },
    "belief": {
        "world/planning_scene.py": (),
        "robot/perception/data_association.py": (),
        "robot/perception/view.py": (),
        "robot/perception/obstacle_volumes.py": (),
        "robot/manipulation/bin_belief.py": (),
    },
}
"""Targets of the mutations: files, and the functions of those that are mutated in part."""
_PACKAGES = sorted(file.parent.name for file in ROOT.glob("*/__init__.py"))
PRODUCT = (
    "*.py", "constraints.txt", "examples/**/*.yaml",
    *(f"{room}/**/*{suffix}" for room in _PACKAGES for suffix in (".py", ".yaml")),
)  # fmt: skip
"""Files on which the outcome of a test depends, beside those of the tests."""
KEPT = ROOT / ".mutants"
ARGUMENTS = ROOT / "benchmarks" / "equivalent_mutants.toml"
COST_OF_A_MUTANT = 6.0
"""CPU seconds, for the forecast of a first run."""
TESTS_OF_A_CONTROL = 25
"""Tests that one process checks for being green without a mutant."""


@dataclass(frozen=True, slots=True)
class Place:
    """A mutant and the room in which it is."""

    room: str
    mutant: Mutant


def main() -> int:
    given = _options().parse_args()
    KEPT.mkdir(exist_ok=True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what is forked must not outlive this process
    try:
        return run(given)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on", file=sys.stderr)
        return 130


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=300, help="mutants; 0: only record what the tests run")
    parser.add_argument("--seed", type=int, default=0, help="which mutants")
    parser.add_argument("--only", action="append", choices=list(ROOMS), metavar="ROOM", help="repeatable")
    parser.add_argument("--budget", type=float, default=60.0, help="CPU s of tests for a mutant")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table there, too")
    return parser


def run(given: argparse.Namespace) -> int:
    rooms = {name: files for name, files in ROOMS.items() if not given.only or name in given.only}
    found = list(places(ROOT, ROOMS))
    arguments = Arguments(ARGUMENTS)
    suite = recorded(given.workers)
    some = [place for place in found if place.room in rooms]
    by_mutant = {place.mutant: place for place in some}
    chosen = [by_mutant[mutant] for mutant in sample(list(by_mutant), given.runs, given.seed)]
    print(
        f"{len(chosen)} of {len(some)} mutants at {len({place.mutant.place for place in some})} places; "
        f"{suite.size} tests",
        file=sys.stderr, flush=True,
    )  # fmt: skip
    results = Run(suite, Kept(KEPT / "results.jsonl"), Kept(KEPT / "controls.jsonl"), given).of(chosen)
    results = [argued(result, arguments) for result in results]
    lines = table(results, ROOMS)
    print(to_text(lines, results))
    survivors = [entry(result.mutant) for result in results if result.verdict == "survived"]
    (KEPT / "survivors.toml").write_text("\n".join(survivors), encoding="utf-8")
    for result in results:
        if result.verdict in NOTICED and arguments.of(result.mutant):
            print(f"{ARGUMENTS.name} is wrong about {result.mutant.key}: {result.word}", file=sys.stderr)
    for words in arguments.stale(place.mutant for place in found):
        print(f"{ARGUMENTS.name} has an entry for nothing: {words}", file=sys.stderr)
    if given.markdown:
        page = to_page(lines, results, " ".join(["python benchmarks/mutants.py", *sys.argv[1:]]))
        given.markdown.write_text(page, encoding="utf-8")
    return 0 if lines[-1].score >= TARGET else 1


def places(root: Path, rooms: dict[str, dict[str, tuple[str, ...]]]) -> Iterator[Place]:
    """All mutants of these rooms."""
    for room, patterns in rooms.items():
        for pattern, functions in patterns.items():
            files = sorted(root.glob(pattern))
            if not files:
                raise FileNotFoundError(f"{room}: there is no {pattern}")
            for path in files:
                name = str(path.relative_to(root))
                for mutant in mutants(name, path.read_text(encoding="utf-8"), functions):
                    yield Place(room, mutant)


def recorded(workers: int) -> Suite:
    """The tests with the lines that they run; those are recorded that have changed."""
    files = {path for room in ROOMS.values() for pattern in room for path in ROOT.glob(pattern)}
    suite = Suite(ROOT, KEPT, sorted(str(path.relative_to(ROOT)) for path in files))
    stale = suite.stale()
    if stale:
        print(
            f"{len(stale)} files of tests to record, about {len(stale) * COST_OF_A_FILE / 60:.0f} CPU "
            f"minutes on {workers} workers; kept in {KEPT}",
            file=sys.stderr, flush=True,
        )  # fmt: skip
        suite.record(stale, workers)
    suite.load()
    if suite.bad:
        print(f"{len(suite.bad)} tests are red or skipped, and judge no mutant:", file=sys.stderr)
        print("\n".join(f"  {name}" for name in suite.bad[:10]), file=sys.stderr)
    return suite


def argued(result: Result, arguments: Arguments) -> Result:
    """An equivalent, if it survived and somebody has written down why."""
    argument = arguments.of(result.mutant)
    if result.verdict != "survived" or not argument:
        return result
    return replace(result, verdict="equivalent", argument=argument)


class Run:
    """Mutants through their tests."""

    def __init__(self, suite: Suite, kept: Kept, controls: Kept, given: argparse.Namespace) -> None:
        self._suite, self._kept, self._controls = suite, kept, controls
        self._budget: float = given.budget
        self._workers: int = given.workers
        files = sorted(path for pattern in PRODUCT for path in ROOT.glob(pattern))
        self._sources = digest(*(str(path) for path in files), *(path.read_bytes() for path in files))
        self._runner: Runner | None = None
        self._selections: dict[Mutant, Selection] = {}
        self._unsound: set[str] = set()
        """Tests that are red in a forked process without any mutant."""

    def of(self, chosen: Sequence[Place]) -> list[Result]:
        """The result of each, in their order."""
        self._run(chosen)
        while again := self._wrongly_killed(chosen):
            self._run(again)
        return [self._result(place) for place in chosen]

    def _run(self, chosen: Sequence[Place]) -> None:
        """Run the mutants of which nothing is known."""
        mutants = [place.mutant for place in chosen]
        waiting = [each for each in mutants if self._select(each).tests and not self._known(each)]
        if not waiting:
            return
        spent = self._kept.values("cpu")
        cost = sum(spent) / len(spent) if len(spent) >= 20 else COST_OF_A_MUTANT
        print(
            f"{len(waiting)} to run, about {len(waiting) * cost / 60:.0f} CPU minutes on "
            f"{self._workers} workers",
            file=sys.stderr, flush=True,
        )  # fmt: skip
        jobs = (Job(mutant, self._select(mutant)) for mutant in waiting)
        for number, (job, outcome) in enumerate(self._outcomes(jobs), 1):
            mutant = job.mutant
            assert mutant is not None
            self._keep(mutant, job.selection, outcome)
            words = (
                f"{mutant.file}:{mutant.line} {mutant.operator}: {outcome.verdict} {outcome.test}".rstrip()
            )
            print(f"  {number}/{len(waiting)} {words}, {outcome.cpu:.1f} s", file=sys.stderr, flush=True)

    def _outcomes(self, jobs: Iterator[Job]) -> Iterator[tuple[Job, Outcome]]:
        if self._runner is None:
            self._runner = Runner(ROOT, self._workers)
        return self._runner.run(jobs)

    def _select(self, mutant: Mutant) -> Selection:
        if mutant not in self._selections:
            self._selections[mutant] = self._suite.select(mutant, self._budget, self._unsound)
        return self._selections[mutant]

    def _keep(self, mutant: Mutant, selection: Selection, outcome: Outcome) -> None:
        tests = [outcome.test] if outcome.verdict in NOTICED else [test.id for test in selection.tests]
        self._kept.add(
            mutant.identity,
            self._state(tests),
            verdict=outcome.verdict, test=outcome.test, message=outcome.message, cpu=round(outcome.cpu, 2),
        )  # fmt: skip

    def _state(self, tests: Sequence[str]) -> str:
        """Hash of the sources and of what these tests are."""
        files = sorted({name.split("::")[0] for name in tests})
        return digest(self._sources, *tests, *(stamp(ROOT, file) for file in files))

    def _known(self, mutant: Mutant) -> dict[str, str] | None:
        """Return the outcome of the mutant, if it was run with these sources and these tests.

        The test that noticed a mutant must be the same as then, and sound.
        """
        row = self._kept.get(mutant.identity)
        if row is None:
            return None
        tests = [test.id for test in self._select(mutant).tests]
        if row["verdict"] in NOTICED:
            tests = [test for test in tests if test == row["test"]]
        return row if tests and row["state"] == self._state(tests) else None

    def _result(self, place: Place) -> Result:
        selection, row = self._select(place.mutant), self._known(place.mutant)
        if row is None:  # no test runs it
            return Result(place.mutant, place.room, "survived")
        ran, left = len(selection.tests), selection.left
        return Result(place.mutant, place.room, row["verdict"], row["test"], row["message"], ran, left)

    def _wrongly_killed(self, chosen: Sequence[Place]) -> list[Place]:
        """Places whose mutants were killed by tests that are red without them, too."""
        rows = {place: row for place in chosen if (row := self._known(place.mutant)) is not None}
        killers = {row["test"] for row in rows.values() if row["verdict"] in NOTICED}
        tests = {test.id: test for place in rows for test in self._select(place.mutant).tests}
        self._control([tests[name] for name in sorted(killers)])
        found = {name for name in killers if not self._is_green(name)}
        for name in sorted(found):
            print(f"red without a mutant, so it judges none: {name}", file=sys.stderr, flush=True)
        self._unsound |= found
        self._selections.clear()
        return [place for place, row in rows.items() if row["test"] in found]

    def _control(self, tests: Sequence[Test]) -> None:
        """Run tests without a mutant, if they were not with these sources."""
        while waiting := [test for test in tests if self._is_green(test.id) is None]:
            print(f"{len(waiting)} tests to check without a mutant", file=sys.stderr, flush=True)
            parts = [waiting[n : n + TESTS_OF_A_CONTROL] for n in range(0, len(waiting), TESTS_OF_A_CONTROL)]
            for _, outcome in self._outcomes(Job(None, self._suite.selection(part)) for part in parts):
                for name in {*outcome.ended, *outcome.red}:
                    self._controls.add(name, self._state([name]), green=name not in outcome.red)

    def _is_green(self, name: str) -> bool | None:
        """Whether a test is green without a mutant; None: that is not known for these sources."""
        row = self._controls.get(name)
        return row["green"] if row is not None and row["state"] == self._state([name]) else None


if __name__ == "__main__":
    sys.exit(main())

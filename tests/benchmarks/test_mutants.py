"""The way of a mutant: which tests run it, how they end, and what is made of that."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import dedent
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
Program = Callable[[str], ModuleType]

LIBRARY = """
    LIMIT = 3

    def small(n):
        return n < LIMIT

    def large(n):
        if n > 100:
            return True
        return False

    def count(n):
        steps = 0
        while steps < n:
            steps += 1
        return steps
"""
TESTS = """
    import os
    import subprocess
    import sys

    import pytest
    from .helper import six

    from picktree.lib import count, large, small

    @pytest.fixture(scope="module")
    def answer():
        return small(1)

    def test_fixture(answer):
        assert answer

    def test_fixture_again(answer):
        assert answer

    def test_child():
        program = "from picktree.lib import large; assert not large(7)"
        subprocess.run([sys.executable, "-c", program], check=True)

    def test_fork():
        if not (pid := os.fork()):
            large(200)
            os._exit(0)
        os.waitpid(pid, 0)

    def test_count():
        assert count(3) == 3

    def test_red():
        assert small(six())
"""


@pytest.fixture(scope="module")
def suite(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The tests of a small checkout, which is a package as ours is, recorded."""
    root = tmp_path_factory.mktemp("checkout")
    (root / "tests").mkdir()
    (root / "picktree").symlink_to(root)
    (root / "__init__.py").touch()
    # What the program that runs mutants takes from the package under test.
    (root / "files").mkdir()
    (root / "files" / "__init__.py").write_text("def pin() -> None:\n    pass\n")
    (root / "lib.py").write_text(dedent(LIBRARY).lstrip())
    (root / "tests" / "__init__.py").touch()
    (root / "tests" / "helper.py").write_text("def six():\n    return 6\n")
    (root / "tests" / "test_lib.py").write_text(dedent(TESTS).lstrip())
    made = program("_mutant_coverage").Suite(root, root / ".mutants", ["lib.py"])
    assert made.stale() == ["tests/test_lib.py"]
    made.record(made.stale(), workers=1)
    made.load()
    return made


def of_library(program: Program, operator: str, before: str) -> Any:
    found = program("_mutant_operators").mutants("lib.py", dedent(LIBRARY).lstrip())
    return next(mutant for mutant in found if (mutant.operator, mutant.before) == (operator, before))


def selected(suite: Any, mutant: Any, budget: float = 60.0) -> list[str]:
    return [test.id.split("::")[1] for test in suite.select(mutant, budget).tests]


def test_what_a_fixture_runs_is_run_by_all_tests_that_use_it(program: Program, suite: Any) -> None:
    mutant = of_library(program, "boundary", "return n < LIMIT")
    assert sorted(selected(suite, mutant)) == ["test_fixture", "test_fixture_again"]


def test_what_a_process_of_a_test_runs_the_test_runs(program: Program, suite: Any) -> None:
    assert sorted(selected(suite, of_library(program, "boundary", "if n > 100:"))) == [
        "test_child",
        "test_fork",
    ]
    assert selected(suite, of_library(program, "constant", "return True")) == ["test_fork"]
    assert selected(suite, of_library(program, "constant", "return False")) == ["test_child"]


def test_of_a_constant_come_the_tests_first_that_run_its_users(program: Program, suite: Any) -> None:
    names = selected(suite, of_library(program, "constant", "LIMIT = 3"))
    assert sorted(names[:2]) == ["test_fixture", "test_fixture_again"]
    assert sorted(names[2:]) == ["test_child", "test_count", "test_fork"]


def test_a_red_test_judges_none(suite: Any) -> None:
    assert suite.bad == ["tests/test_lib.py::test_red"]


def test_a_budget_leaves_the_dearest_out(program: Program, suite: Any) -> None:
    mutant = of_library(program, "boundary", "if n > 100:")
    cheap = suite.select(mutant, 0.0)
    assert (len(cheap.tests), cheap.left) == (1, 1)
    both = suite.select(mutant, 60.0)
    assert both.tests[0] == cheap.tests[0]
    assert both.tests[0].cost <= both.tests[1].cost
    assert suite.select(mutant, 60.0, without=[both.tests[0].id]).tests == both.tests[1:]


@pytest.mark.parametrize("file", ["tests/test_lib.py", "tests/helper.py", "lib.py"])
def test_a_record_is_good_until_its_tests_or_sources_change(
    program: Program, suite: Any, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    coverage = program("_mutant_coverage")
    root, folder = suite._root, suite._folder

    def stale() -> list[str]:
        coverage.stamp.cache_clear()
        return coverage.Suite(root, folder, ["lib.py"]).stale()

    text = (root / file).read_text()
    assert stale() == []
    (root / file).write_text(text + "\nMORE = 1\n")
    assert stale() == ["tests/test_lib.py"]
    (root / file).write_text(text)
    assert stale() == []


RUNNING = """
    import json, sys
    from pathlib import Path
    import _mutant_runs
    from _mutant_coverage import Suite
    from _mutant_operators import mutants

    root = Path.cwd()
    _mutant_runs.CPU_SPARE, _mutant_runs.LIBRARIES = 0.5, ()
    suite = Suite(root, root / ".mutants", ["lib.py"])
    suite.load()
    found = mutants("lib.py", (root / "lib.py").read_text())
    wanted = [m for m in found if [m.operator, m.before] in json.loads(sys.argv[1])]
    tests = suite.select(wanted[0], 60.0)
    jobs = [*(_mutant_runs.Job(m, suite.select(m, 60.0)) for m in wanted), _mutant_runs.Job(None, tests)]
    for job, outcome in _mutant_runs.Runner(root, 2).run(jobs):
        name = f"{job.mutant.operator}: {job.mutant.after}" if job.mutant else "none"
        print(json.dumps([name, outcome.verdict, outcome.test.split("::")[-1], outcome.message]))
"""


def test_how_mutants_end(suite: Any) -> None:
    wanted = [
        ["comparison", "return n < LIMIT"],
        ["boundary", "return n < LIMIT"],
        ["comparison", "if n > 100:"],
        ["deletion", "steps += 1"],
    ]
    files = sorted(path for path in suite._root.rglob("*") if "__pycache__" not in path.parts)
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "benchmarks")}
    ran = subprocess.run(
        [sys.executable, "-c", dedent(RUNNING), json.dumps(wanted)],
        cwd=suite._root, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    told = {name: ended for name, *ended in map(json.loads, ran.stdout.splitlines())}
    noticed = told.pop("comparison: return n >= LIMIT")
    assert noticed[0] == "killed"
    assert noticed[1] in ("test_fixture", "test_fixture_again")
    assert noticed[2] == "assert False"
    in_a_child = told.pop("comparison: if n <= 100:")
    assert in_a_child[:2] == ["killed", "test_child"]
    assert told == {
        "boundary: return n <= LIMIT": ["survived", "", ""],
        "deletion: pass": ["timed out", "test_count", "it computes without end"],
        "none": ["survived", "", ""],
    }
    assert sorted(path for path in suite._root.rglob("*") if "__pycache__" not in path.parts) == files


class Scripted:
    """Tests that are red for these mutants, and one that is always red, in place of processes."""

    def __init__(self, runs: ModuleType, red: dict[str, set[str]], broken: str) -> None:
        self._runs, self._red, self._broken = runs, red, broken
        self.asked: list[tuple[str, list[str]]] = []

    def run(self, jobs: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
        for job in jobs:
            name = job.mutant.after if job.mutant else ""
            tests = [test.id for test in job.selection.tests]
            self.asked.append((name, tests))
            red = [test for test in tests if test == self._broken or test in self._red.get(name, ())]
            verdict = "killed" if red else "survived"
            yield job, self._runs.Outcome(verdict, (*red, "")[0], "", 1.0, tuple(red), frozenset(tests))


class Selecting:
    """A suite in which all tests run all places."""

    def __init__(self, coverage: ModuleType, names: Sequence[str]) -> None:
        self._coverage = coverage
        self._tests = [coverage.Test(name, 0.1) for name in names]

    def select(self, mutant: object, budget: float, without: Iterable[str]) -> Any:
        return self.selection([test for test in self._tests if test.id not in without])

    def selection(self, tests: Sequence[Any]) -> Any:
        return self._coverage.Selection(tuple(tests), tuple(test.cost for test in tests), 0)


BROKEN, SOUND = (f"tests/benchmarks/test_mutants.py::{name}" for name in ("broken", "sound"))


def running(
    program: Program, folder: Path, red: dict[str, set[str]], broken: str = ""
) -> tuple[Any, Scripted]:
    """A run over these tests, and what was asked of it."""
    mutants, kept = program("mutants"), program("_mutant_table").Kept
    given = argparse.Namespace(budget=60.0, workers=1)
    tests = Selecting(program("_mutant_coverage"), [BROKEN, SOUND])
    made = mutants.Run(tests, kept(folder / "results.jsonl"), kept(folder / "controls.jsonl"), given)
    made._runner = Scripted(program("_mutant_runs"), red, broken)
    return made, made._runner


def places(program: Program) -> list[Any]:
    found = program("_mutant_operators").mutants("m.py", "def f(a):\n    return a < 3\n")
    return [program("mutants").Place("skills", mutant) for mutant in found[:2]]


def verdicts(results: Sequence[Any]) -> list[tuple[str, str]]:
    return [(result.verdict, result.test) for result in results]


def test_a_test_that_is_red_without_a_mutant_kills_none(program: Program, tmp_path: Path) -> None:
    red = {"return a <= 3": {SOUND}}
    run, runner = running(program, tmp_path, red, broken=BROKEN)
    assert verdicts(run.of(places(program))) == [("killed", SOUND), ("survived", "")]
    assert runner.asked == [
        ("return a <= 3", [BROKEN, SOUND]),
        ("return a >= 3", [BROKEN, SOUND]),
        ("", [BROKEN]),
        ("return a <= 3", [SOUND]),
        ("return a >= 3", [SOUND]),
        ("", [SOUND]),
    ]


def test_a_run_goes_on_where_it_stopped(program: Program, tmp_path: Path) -> None:
    red = {"return a <= 3": {SOUND}}
    first, second = places(program)
    run, _ = running(program, tmp_path, red)
    run.of([first])
    with (tmp_path / "results.jsonl").open("a") as file:
        file.write('{"name": "cut o')  # the process was killed
    run, runner = running(program, tmp_path, red)
    assert verdicts(run.of([first, second])) == [("killed", SOUND), ("survived", "")]
    assert runner.asked == [("return a >= 3", [BROKEN, SOUND])]


@pytest.mark.parametrize("sources", [True, False])
def test_what_has_changed_runs_again(program: Program, tmp_path: Path, sources: bool) -> None:
    run, _ = running(program, tmp_path, {})
    run.of(places(program)[:1])
    run, runner = running(program, tmp_path, {"return a <= 3": {SOUND}})
    if sources:
        run._sources = "others"
    else:
        run._suite = Selecting(program("_mutant_coverage"), [SOUND])
    assert verdicts(run.of(places(program)[:1])) == [("killed", SOUND)]
    assert runner.asked[0][0] == "return a <= 3"


def results(program: Program) -> list[Any]:
    """Of two rooms: two killed, one timed out, one survivor, one that no test runs."""
    made = program("_mutant_table").Result
    source = "def f(a):\n    return a < 3 and a > 0\n"
    one, two, three, four, five = program("_mutant_operators").mutants("skills/m.py", source)[:5]
    return [
        made(one, "skills", "killed", "tests/test_m.py::test_f", "assert 1"),
        made(two, "skills", "survived", ran=3, left=2),
        made(three, "skills", "killed", "tests/test_m.py::test_f", "assert 1"),
        made(four, "recovery", "timed out", "tests/test_m.py::test_f", "it hangs"),
        made(five, "recovery", "survived"),
    ]


def test_the_table(program: Program) -> None:
    table = program("_mutant_table")
    told = results(program)
    lines = table.table(told, ["skills", "recovery", "scorer"])
    assert lines[-1].score == 0.6
    first, second = (result.mutant for result in told if result.verdict == "survived")
    assert table.to_text(lines, told).splitlines() == [
        "room      mutants  killed  timed out  survived  equivalent   score  95 % interval",
        "skills          3       2          0         1           0  66.7 %  20.8 … 93.9 %",
        "recovery        2       0          1         1           0  50.0 %   9.5 … 90.5 %",
        "all             5       2          1         2           0  60.0 %  23.1 … 88.2 %",
        "",
        "Survived:",
        f"skills/m.py:2 f ({first.operator}): no red test of 3 that run it; 2 more were too dear",
        f"    - {first.before}",
        f"    + {first.after}",
        f"skills/m.py:2 f ({second.operator}): no test runs it",
        f"    - {second.before}",
        f"    + {second.after}",
    ]


def test_an_argued_equivalent_counts_neither_way(program: Program, tmp_path: Path) -> None:
    table, told = program("_mutant_table"), results(program)
    survivor = told[1].mutant
    path = tmp_path / "equivalent.toml"
    blank = table.entry(survivor)
    path.write_text(blank.replace('because = ""', 'because = """Nobody\ncan tell."""'))
    arguments = table.Arguments(path)
    told = [program("mutants").argued(result, arguments) for result in told]
    assert [result.verdict for result in told].count("equivalent") == 1
    assert told[1].word == "Nobody can tell."
    lines = table.table(told, ["skills", "recovery"])
    assert (lines[0].score, lines[-1].score) == (1.0, 0.75)
    assert "Equivalent:" in table.to_text(lines, told)
    assert "## Equivalent" in table.to_page(lines, told, "python benchmarks/mutants.py")
    assert arguments.stale([survivor]) == []
    assert arguments.stale([replace(survivor, before="return a")]) == [
        f"skills/m.py, f: {survivor.before}"
    ]  # the line reads otherwise now


def test_an_entry_without_an_argument_is_refused(program: Program, tmp_path: Path) -> None:
    table = program("_mutant_table")
    path = tmp_path / "equivalent.toml"
    path.write_text(table.entry(results(program)[1].mutant))
    with pytest.raises(
        ValueError, match=r"^equivalent\.toml: an entry needs file, function, operator, line, mutant"
    ):
        table.Arguments(path)


def test_the_file_of_arguments_fits(program: Program) -> None:
    """The entries fit mutants of the present code; which rooms there are is held here, too."""
    mutants, table = program("mutants"), program("_mutant_table")
    found = [place.mutant for place in mutants.places(ROOT, mutants.ROOMS)]
    assert table.Arguments(mutants.ARGUMENTS).stale(found) == []
    assert len(found) == len({mutant.identity for mutant in found})

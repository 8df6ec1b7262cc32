"""What a rehearsal costs: the example with all its branches, start-up included, and a mission of 1,000 nodes.

python benchmarks/rehearsal.py [--runs 7] [--nodes 1000]
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

from languages import text_of
from picktree.authoring.rehearsal import rehearse
from picktree.authoring.rehearsal.case_checks import examine_cases
from picktree.files.yaml import read_document
from picktree.trees.loading import parse_mission

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "sort_by_colour.yaml"
CASES = """\
picktree: 1
kind: cases
objects: {a: {kind: block, colour: red}, b: {kind: can, colour: blue}}
leaves: {Grasp: [grasp.missed, SUCCESS], Place: [grasp.slipped, SUCCESS]}
cases: {it: {expect: {status: SUCCESS}}}
"""


def command(runs: int) -> None:
    """The command as it is typed, in a process of its own."""
    line = [sys.executable, "-m", "picktree", "rehearse", str(EXAMPLE), "-q", "--full-coverage"]
    walls: list[float] = []
    cpus: list[float] = []
    for _ in range(runs):
        wall, before = time.perf_counter(), os.times()
        subprocess.run(line, check=True, stdout=subprocess.DEVNULL)
        after = os.times()
        walls.append(time.perf_counter() - wall)
        cpus.append(
            after.children_user + after.children_system - before.children_user - before.children_system
        )
    shown = ", ".join(f"{name} {_span(values)}" for name, values in (("wall", walls), ("CPU", cpus)))
    print(f"picktree rehearse {EXAMPLE.name} --full-coverage, {runs} runs: {shown}")


def large(nodes: int, runs: int) -> None:
    """Checking and rehearsing one case of a large mission."""
    mission = parse_mission(text_of(nodes), Path("large.yaml"))
    document = read_document(Path("cases.yaml"), "cases", CASES)
    checks: list[float] = []
    rehearsals: list[float] = []
    for _ in range(runs):
        began = time.process_time()
        cases = examine_cases(document, mission).cases
        checked = time.process_time()
        result = rehearse(mission, cases)
        checks.append(checked - began)
        rehearsals.append(time.process_time() - checked)
        assert result.passed
    case = result.cases[0]
    print(f"{nodes} nodes, {case.ticks} ticks: check CPU {_span(checks)}, rehearse CPU {_span(rehearsals)}")


def _span(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} s ({min(values):.2f} to {max(values):.2f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--nodes", type=int, default=1000)
    given = parser.parse_args()
    command(given.runs)
    large(given.nodes, given.runs)


if __name__ == "__main__":
    main()

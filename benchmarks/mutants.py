"""Mutation run: do the tests of a module notice small mistakes in it? The mutants are cosmic-ray's.

    python benchmarks/mutants.py robot/control/soft_limits.py tests/control/test_control_boundaries.py
    make mutants MODULE=simulation/scorer.py TESTS=tests/simulation/test_simulation_scorer.py COUNT=40

A sample of the module's mutants is drawn by seed. Each is tried in a copy of the checkout as git has it
staged: the mutated file takes the place of the original, and the tests run until one is red. Survivors are
printed as differences. A survivor asks for a test, unless it changes nothing that anybody could notice.
Exit code 0: all were noticed; 1: some survived; 2: the tests are red without a mutant.
"""

from __future__ import annotations

import argparse
import os
import random
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from _campaign import ROOT, rate


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("module", type=Path, help="file to mutate, from the checkout's root")
    parser.add_argument("tests", nargs="+", help="files or folders of its tests")
    parser.add_argument("--count", type=int, default=20, help="mutants; 20 unless given")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--timeout", type=float, default=120.0, help="wall time after which tests hang, s")
    given = parser.parse_args()
    try:
        import cosmic_ray.commands  # noqa: F401
    except ImportError:
        print("cosmic-ray is missing: pip install -c constraints.txt 'picktree[mutants]'", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as name:
        return campaign(given, Path(name) / ROOT.name)


def campaign(given: argparse.Namespace, copy: Path) -> int:
    from cosmic_ray.commands import init
    from cosmic_ray.mutating import mutate_and_test
    from cosmic_ray.testing import run_tests
    from cosmic_ray.work_db import use_db
    from cosmic_ray.work_item import TestOutcome

    subprocess.run(["git", "checkout-index", "-a", f"--prefix={copy}/"], cwd=ROOT, check=True)
    os.chdir(copy)
    # A mutant as long as its original, written in the same second, would be taken for the compiled one.
    os.environ |= {"PYTHONPATH": str(copy / "links"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = shlex.join([sys.executable, "-m", "pytest", "-qxm", "not slow", *given.tests])
    began = time.monotonic()
    outcome, output = run_tests(command, given.timeout)
    if outcome != TestOutcome.SURVIVED:
        print(f"{output}\nThe tests are red without a mutant.", file=sys.stderr)
        return 2
    with use_db("mutants.sqlite") as database:
        init([given.module], database, {})
        mutants = [each for each in database.work_items if "BinaryOperator_BitOr" not in _operator(each)]
    mutants.sort(key=lambda item: (_operator(item), item.mutations[0].occurrence))
    drawn = random.Random(given.seed).sample(mutants, min(given.count, len(mutants)))
    seconds = (time.monotonic() - began) * len(drawn) / 60
    print(
        f"{len(drawn)} of {len(mutants)} mutants, at most {seconds:.0f} minutes", file=sys.stderr, flush=True
    )
    killed = 0
    for number, item in enumerate(drawn, start=1):
        found = mutate_and_test(item.mutations, command, given.timeout)
        survived = found.test_outcome == TestOutcome.SURVIVED
        killed += not survived
        change = item.mutations[0]
        place = f"{change.module_path}:{change.start_pos[0]} {_operator(item).removeprefix('core/')}"
        print(f"{number} {'survived' if survived else 'killed'}  {place}", file=sys.stderr, flush=True)
        if survived:
            print(found.diff + "\n")
    print(rate("killed", killed, len(drawn)))
    return 0 if killed == len(drawn) else 1


def _operator(item: Any) -> str:
    """Return the name of a mutant's operator. Those of `|` change annotations, which nobody evaluates."""
    return item.mutations[0].operator_name


if __name__ == "__main__":
    sys.exit(main())

"""A campaign of mistakes: mutated files of all kinds through the checker, and what it passes through loading.

Counted against us: an exception, a file that takes more than a second of CPU, and an "ok" that then fails in
loading or, of a mission, at the first tick of a rehearsal. A file of which the checker warns that it may fail
in just this way (P302) was not called ok.

python benchmarks/file_mutations.py --runs 20000
"""

from __future__ import annotations

import json
import random
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from _campaign import ROOT, Row, campaign, finished, options
from _file_mutants import mutant, told, told_all
from picktree.apps.cli.file_schemas import CHECKS
from picktree.authoring.rehearsal.case_checks import examine_cases
from picktree.authoring.rehearsal.cases import CaseFile
from picktree.authoring.rehearsal.leaf_roles import is_stubbed
from picktree.authoring.rehearsal.mission_staging import scene_of, stub_mission
from picktree.authoring.rehearsal.rehearsal import CoverageRecord, rehearse_case
from picktree.files import FileError, PicktreeError
from picktree.files.file_checks import check_files
from picktree.files.yaml import read_document
from picktree.simulation import load_faults
from picktree.trees import Mission
from picktree.trees.loading import examine, load_mission
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

CHUNK = 250
"""Mutants of one job."""
LIMIT = 1.0
"""CPU seconds that one file may take."""
FOLDERS = ("examples", "trees/library", "world/scenes", "world/robots", "tests/check/good")


@dataclass(frozen=True)
class Job:
    seed: int


@cache
def corpus() -> tuple[tuple[Path, str], ...]:
    files = (file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.yaml")))
    return tuple((file, file.read_text(encoding="utf-8")) for file in files)


def one(job: Job, folder: Path) -> Row:
    rng = random.Random(job.seed)
    words = [text for _, text in corpus()]
    counts: Counter[str] = Counter()
    worst, problems = 0.0, list[str]()
    with tempfile.TemporaryDirectory() as name:
        corpus_copy = Path(name)
        _copy_corpus(corpus_copy)
        check_files([ROOT / "examples"], CHECKS)  # imports are no cost of the first mutant
        for number in range(CHUNK):
            source, text = rng.choice(corpus())
            raw = mutant(text, words, rng)
            file = corpus_copy / source.relative_to(ROOT)
            file.write_bytes(raw)
            began = time.process_time()
            outcome, problem = _outcome(file)
            seconds = time.process_time() - began
            file.write_text(text, encoding="utf-8")
            counts[outcome] += 1
            worst = max(worst, seconds)
            if seconds > LIMIT:
                problem = problem or f"{seconds:.2f} s"
            if problem:
                kept = folder / f"{number}_{source.name}"
                kept.write_bytes(raw)
                problems.append(f"{kept}: {problem}")
    return {"counts": counts, "worst": worst, "problems": problems}


def _copy_corpus(folder: Path) -> None:
    """Files that name each other stay beside each other."""
    for name in FOLDERS:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name)


def _outcome(file: Path) -> tuple[str, str]:
    """Return the outcome of one file, and what is wrong with it, if anything."""
    try:
        report = check_files([file], CHECKS)
        report.to_text()
    except Exception:  # noqa: BLE001 - what the campaign looks for
        return "exception", traceback.format_exc(limit=-4)
    if report.errors:
        return "refused", ""
    if any(fault.code == "P302" for fault in report.faults):
        return "warned", ""
    try:
        return "passed", _use(file)
    except PicktreeError as error:
        return "passed", f"ok, and then: {error}"
    except Exception:  # noqa: BLE001 - what the campaign looks for
        return "passed", "ok, and then: " + traceback.format_exc(limit=-4)


def _use(file: Path) -> str:
    kind = next(
        (
            line.split(":")[1].strip()
            for line in file.read_text("utf-8-sig").splitlines()
            if line.startswith("kind:")
        ),
        "",
    )
    loaders: dict[str, Callable[[], object]] = {
        "scene": lambda: load_scene(str(file)),
        "robot": lambda: load_robot(str(file)),
        "faults": lambda: load_faults(file),
        "cases": lambda: _cases(file),
    }
    if kind in loaders:
        loaders[kind]()
        return ""
    reading = examine(read_document(file, "mission"))
    return "" if reading.mission.library else _first_tick(load_mission(file))


def _cases(file: Path, mission: Mission | None = None) -> CaseFile:
    found = examine_cases(read_document(file, "cases"), mission)
    if found.errors:
        raise FileError(found.errors)
    return found.cases


def _first_tick(mission: Mission) -> str:
    """Return why the first tick of a rehearsal fails, where a mistake in the text makes it fail."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cases.yaml"
        parameters = {
            port.key: _some_value(port.type.name, port.type.many)
            for port in mission.parameters
            if port.required
        }
        leaves = json.dumps(_outputs(mission))
        case = (
            f"{{parameters: {json.dumps(parameters)}, leaves: {leaves}, halt_after: 1, expect: {{ticks: 1}}}}"
        )
        path.write_text(f"picktree: 1\nkind: cases\ncases:\n  first: {case}\n")
        cases = _cases(path, mission)
    staging = stub_mission(mission, scene_of(mission))
    result = rehearse_case(staging, cases.cases[0], cases.document, CoverageRecord())
    if result.cause in ("internal.error", "tree.missing_input", "tree.no_case"):
        return f"ok, and then at the first tick: {result.cause}: {result.message}"
    return ""


def _outputs(mission: Mission) -> dict[str, Row]:
    """An answer for each skill whose outputs the rehearsal cannot think up."""
    played = (spec.node for tree in mission.trees.values() for spec in tree.root.iterate() if spec.node)
    return {
        node.declaration.id: {
            "outputs": {
                port.key: _some_value(port.type.name, port.type.many) for port in node.declaration.outputs
            }
        }
        for node in played
        if is_stubbed(node) and node.declaration.outputs and node.declaration.id != "Observe"
    }


def _some_value(name: str, many: bool) -> Any:
    value = {"int": 1, "float": 1.0, "bool": True}.get(name, "x")
    return [value] if many else value


def main() -> int:
    given = options(__file__, __doc__, runs=20_000, what="files").parse_args()
    jobs = [Job(given.first + n) for n in range(-(-given.runs // CHUNK))]
    rows = finished(campaign(given, jobs, one, cost=CHUNK * 0.03, short=told))
    print(told_all(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())

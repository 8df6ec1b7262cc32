"""Runs in which something was made to go wrong, and whether `explain` names it.

    python benchmarks/planted.py
    python benchmarks/planted.py --only slippery --keep /tmp/planted

For each run the answers that count are stated before it is made: the cause, and what the sentence must name.
Each is explained twice: as an analyst would who knows of no fault file, and with the events of the faults.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from _planted_runs import PLANTED, Planted

if TYPE_CHECKING:
    from picktree.analysis.explain.investigation.explanation import RootCause
    from picktree.logs.run_log import Stamped
    from picktree.world.journal import JournalEvent

COST_A_RUN = 6.0
"""CPU seconds, for the forecast."""


def record(planted: Planted, folder: Path) -> Path:
    """Run it in a new folder; where its log is."""
    from picktree.session.session import RunRequest, Session

    folder.mkdir(parents=True)
    (folder / "scene.yaml").write_text(planted.scene)
    (folder / "mission.yaml").write_text(planted.mission)
    (folder / "faults.yaml").write_text(planted.faults)
    (folder / "hurry.py").write_text(planted.plugin)
    request = RunRequest(
        mission=folder / "mission.yaml",
        seed=planted.seed,
        backend=planted.backend,  # pyright: ignore[reportArgumentType]
        faults=folder / "faults.yaml" if planted.faults else None,
        out=folder / "runs",
        limit=planted.limit,
    )
    return Session(request).run().folder


@dataclass(frozen=True)
class Answer:
    """What `explain` made of one run, without and with the faults' own events."""

    outcome: str
    blind: RootCause | None
    """Its first root cause when nobody knows of faults."""
    quoted: bool
    """Whether with them it names the same, and quotes the fault where one was injected."""
    seconds: float


def explained(folder: Path, planted: Planted) -> Answer:
    """Both explanations of a run."""
    from picktree.analysis import Run
    from picktree.analysis.explain.explain import explain

    class Blind(Run):
        """A run whose log holds no word of a fault."""

        @cached_property
        def events(self) -> tuple[Stamped[JournalEvent], ...]:
            return tuple(at for at in super().events if at.record.kind != "fault")

    with Blind(folder) as run:
        began = time.process_time()
        blind = explain(run)
        seconds = time.process_time() - began
    with Run(folder) as run:
        shown = explain(run)
    first = blind.root_causes[0] if blind.root_causes else None
    told = shown.root_causes[0] if shown.root_causes else None
    quoted = told is not None and first is not None and told.title == first.title
    if planted.faults:
        quoted = quoted and told is not None and bool(told.planted)
    return Answer(blind.outcome.status, first, quoted, seconds)


def right(planted: Planted, cause: RootCause | None) -> bool:
    return (
        cause is not None
        and cause.cause in planted.causes
        and all(word in cause.title for word in planted.says)
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="those whose name holds this")
    parser.add_argument("--seeds", default="", help="comma-separated, for all, instead of their own")
    parser.add_argument("--runs", type=int, default=len(PLANTED), help="how many of them, from the first")
    parser.add_argument("--keep", type=Path, help="folder for the logs")
    arguments = parser.parse_args()
    chosen = [planted for planted in PLANTED if arguments.only in planted.name][: arguments.runs]
    seeds = [int(seed) for seed in arguments.seeds.split(",") if seed]
    jobs = [(planted, seed) for planted in chosen for seed in (seeds or [planted.seed])]
    print(f"{len(jobs)} runs, about {len(jobs) * COST_A_RUN:.0f} CPU seconds", flush=True)
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        for planted, seed in jobs:
            folder = (arguments.keep or Path(scratch)) / f"{planted.name}-{seed}"
            answer = explained(record(replace(planted, seed=seed), folder), planted)
            blind = right(planted, answer.blind)
            wrong += not (blind and answer.quoted)
            verdict = "right" if blind and answer.quoted else "right, not quoted" if blind else "WRONG"
            print(f"{planted.name} (seed {seed}): {planted.what}")
            print(
                f"  counts:  {' or '.join(planted.causes)}"
                + (f", naming {', '.join(planted.says)}" * bool(planted.says))
            )
            said = f"{answer.blind.cause}: {answer.blind.title}" if answer.blind else "no root cause"
            print(f"  said:    {said}")
            print(
                f"  {verdict}; the run: {answer.outcome}; explained in {answer.seconds:.1f} CPU s", flush=True
            )
    print(f"{len(jobs) - wrong} of {len(jobs)} named")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

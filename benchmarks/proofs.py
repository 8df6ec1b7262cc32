"""Benchmark of `explain --prove` on hypotheses whose truth is known from the labels of drawn situations.

    python benchmarks/proofs.py --situations benchmarks/results/situations --runs 40
    python benchmarks/proofs.py --runs 40 --minutes 0           # report what is there

Situations with a labelled cause are taken from the results of `situations.py`. Each gives hypotheses in the
words of a root cause: the labelled cause, which is to be proven; deviations that the label excludes, and
devices or properties that do not deviate, which are to be refuted. A verdict is right when it is as expected,
and wrong when it is the opposite; `not decided` is counted apart.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, Final, Literal, TypeAlias

from _campaign import RESULTS, Row, campaign, finished, options, rate
from _situation_score import judged
from picktree.analysis import Run, prove
from picktree.analysis.explain import RootCause
from picktree.files import PicktreeError

Expected: TypeAlias = Literal["proven", "refuted"]
COST = 20.0
"""CPU seconds of a proof on the reference machine, for the forecast."""
NICENESS = 10
CODES: Final = {
    "friction": "item.slippery", "heavier": "item.heavy", "larger": "item.larger", "remove": "item.gone",
    "bump": "item.moved", "slip": "item.slipped", "appear": "item.appeared", "gripper_jam": "gripper.jammed",
    "gripper_weak": "gripper.weak", "camera_drop": "camera.silent", "camera_shift": "camera.off",
    "camera_noise": "camera.noisy", "camera_mislabel": "perception.mistaken", "wrench_bias": "wrist.biased",
    "wrench_dead": "wrist.silent", "joint_weak": "joint.weak", "stall": "arm.stalled",
    "no_plan": "planner.refuses", "camera_error": "camera.off", "obstacle": "scene.unknown_obstacle",
    "bin_filled": "scene.unknown_obstacle", "way_blocked": "scene.blocked",
    "items_hidden": "scene.unknown_obstacle", "false_item": "scene.unknown_obstacle",
    "lid_on_bin": "scene.blocked",
}  # fmt: skip
"""Root cause that names a deviation, by its kind. Other kinds have no removal."""
OTHERS: Final[Sequence[tuple[str, str | None]]] = (
    ("gripper.weak", "gripper"), ("camera.off", ""), ("item.heavy", None), ("wrist.biased", "wrist"),
    ("item.slippery", None), ("planner.refuses", "planner"), ("item.larger", None), ("camera.noisy", ""),
)  # fmt: skip
"""Plausible causes with what they are about; empty: every camera; None: the item."""


@dataclass(frozen=True)
class Job:
    """Hypothesis about a situation's run."""

    seed: int
    cause: str
    about: str
    item: str
    since: float
    """Time of the cause as the hypothesis states it, simulated s."""
    failures: tuple[int, ...]
    items: tuple[str, ...]
    missed: bool
    """Whether the outcome is the missed goal, or an item that is not where it belongs."""
    expected: Expected
    of: str
    """Kind of the deviation; `nominal` for a device or property that does not deviate."""
    backend: str
    log: str


def one(job: Job, folder: Path) -> Row:
    """Prove a hypothesis: the row of the results."""
    os.nice(NICENESS - os.nice(0))
    root = RootCause(
        job.cause,
        f"{job.about or job.item} is to have caused it",
        job.failures,
        ended_run=job.missed,
        reasons=(),
        item=job.item,
        time=job.since,
        items=job.items,
        about=job.about,
    )
    found = prove(job.log, cause=root)
    return {
        **{key: getattr(job, key) for key in ("cause", "expected", "of", "backend")},
        "about": job.about or job.item,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "removal": found.experiment.removal is not None,
        "with": [sorted(trial.facts) for trial in found.with_cause],
        "without": [sorted(trial.facts) for trial in found.without],
        "sim_seconds": found.sim_seconds,
        "cpu_seconds": found.cpu_seconds,
    }


def hypotheses(row: Row) -> Iterator[Job]:
    """Yield the hypotheses about a situation with a labelled cause."""
    label, kinds = row["label"], [each["kind"] for each in row["deviations"]]
    cause = judged(row, row["account"])
    failures = tuple(n for n, fact in enumerate(row["account"]["facts"]) if fact == label["target"])
    if label["target"] == "goal":
        failures = tuple(cause["failures"]) if cause else ()
    items = tuple(fact.removeprefix("item ") for fact in row["targets"] if fact.startswith("item "))
    item = next(iter(items), "")
    job = Job(
        seed=row["seed"],
        cause="",
        about="",
        item=item,
        since=0.0,
        failures=failures,
        items=items,
        missed=label["target"] == "goal",
        expected="refuted",
        of="nominal",
        backend=row["backend"],
        log=row["log"],
    )
    alone = sorted({group[0] for group in label["groups"] if len(group) == 1})
    for number in (*alone, *label["excluded"]):
        strike, kind = row["strikes"].get(str(number)), kinds[number]
        if strike is not None and kind in CODES:
            yield replace(
                job,
                cause=CODES[kind],
                about=_about(row["deviations"][number], strike),
                item=strike["item"],
                since=strike["at"],
                expected="proven" if number in alone else "refuted",
                of=kind,
            )
    struck = [row["strikes"][str(n)]["at"] for n in alone if str(n) in row["strikes"]]
    parts = {_part(CODES[kind]) for kind in kinds if kind in CODES}
    free = [(code, about) for code, about in OTHERS if _part(code) not in parts]
    others = [(code, about) for code, about in free if item or about is not None]
    if struck and others:
        code, about = others[row["seed"] % len(others)]
        yield replace(job, cause=code, about=item if about is None else about, since=min(struck))


def _part(code: str) -> str:
    """Return what a root cause takes away: a device, whatever its fault, or a property of an item."""
    family = code.partition(".")[0].replace("perception", "camera")
    return code if family == "item" else family


def _about(deviation: Mapping[str, Any], strike: Row) -> str:
    """Return the device, item or body of a deviation, as a root cause names it."""
    entry = deviation["entry"]
    for key in ("joint", "camera", "name"):
        if entry.get(key):
            return str(entry[key])
    places = [each["at"] for each in deviation["operations"]]
    body = next((at[1] for at in places if at[0] in ("unknown", "cameras") and len(at) > 1), "")
    return str(body or strike["item"] or "")


def report(rows: Sequence[Row]) -> str:
    """Return the rates of the verdicts with their intervals, and the costs."""
    known = [row for row in rows if row["removal"]]
    decided = [row for row in known if row["verdict"] != "not decided"]
    lines = [f"{len(rows)} hypotheses, {len(known)} with a removal"]
    lines.append(rate("decided", len(decided), len(known)))
    lines.append(rate("right of decided", sum(map(_right, decided)), len(decided)))
    for title, key in (("expected", "expected"), ("backend", "backend"), ("deviation", "of")):
        lines += ["", f"right of decided, by {title}"]
        for part in sorted({row[key] for row in known}):
            same = [row for row in known if row[key] == part]
            sure = [row for row in same if row["verdict"] != "not decided"]
            lines.append(rate(f"  {part}", sum(map(_right, sure)), len(sure)) + f"; of {len(same)}")
    if known:
        costs = [sorted(row[key] for row in known) for key in ("sim_seconds", "cpu_seconds")]
        words = (f"{median(c):.0f} ({c[0]:.0f} … {c[-1]:.0f})" for c in costs)
        lines += ["", "median cost of a proof: {} simulated s, {} CPU s".format(*words)]
    lines += ["", "Not right"]
    for row in known:
        if not (row["verdict"] != "not decided" and _right(row)):
            lines.append(
                f"  seed {row['seed']} {row['cause']} {row['about']} ({row['of']}, expected "
                f"{row['expected']}): {row['verdict']}: {row['sentence']}"
            )
    return "\n".join(lines)


def _right(row: Row) -> bool:
    return row["verdict"] == row["expected"]


def labelled(folder: Path) -> list[Row]:
    """Return the last row of each situation with a labelled cause whose log is there."""
    found: dict[int, Row] = {}
    for line in (folder / "results.jsonl").read_text().splitlines():
        row = json.loads(line)["row"]
        if row.get("label", {}).get("status") == "cause" and not row["resumed"]:
            found[row["seed"]] = row
    return [row for row in found.values() if _repeatable(Path(row["log"]))]


def _repeatable(log: Path) -> bool:
    try:
        with Run(log) as run:
            return run.result is not None
    except PicktreeError:
        return False


def main() -> int:
    parser = options(__file__, __doc__, runs=40, what="hypotheses")
    parser.set_defaults(workers=1)
    parser.add_argument(
        "--situations", type=Path, action="append", metavar="FOLDER", help="results of situations.py"
    )
    given = parser.parse_args()
    rows = [row for folder in given.situations or [RESULTS / "situations"] for row in labelled(folder)]
    jobs = [job for row in rows for job in hypotheses(row)][: given.runs]
    found = campaign(given, jobs, one, cost=COST, short=lambda row: f"{row['cause']}: {row['verdict']}")
    print(report(finished(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())

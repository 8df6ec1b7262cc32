"""Benchmark of explanations on drawn situations, whose causes are found by experiment.

    python benchmarks/situations.py --runs 40                  # development draws; goes on where it stopped
    python benchmarks/situations.py --runs 40 --backend kinematic
    python benchmarks/situations.py --runs 40 --minutes 0      # explain and score what is there
    python benchmarks/situations.py --final --runs 450         # the figure, drawn once
    python benchmarks/situations.py --show 17                  # one situation: draw, label, account
    python benchmarks/situations.py --minutes 0 --fit          # write the rates of confidence

A situation is a mission, a scene, a robot, a backend and a seed, with up to three deviations: faults,
changes of the scene, changes of the mission. Its run is made, and continued from the strike with and without
each deviation (`_situation_labels.py`). What ends the outcome is its cause. The log is explained without the
events of its faults, and scored by the table `situation_answers.yaml` (`_situation_score.py`).

A row of the results has draw, label and account. Each report makes the verdicts of them, so that a change of
the table needs no run. Logs and outcomes are kept: those that other code has explained are explained again,
and not run again.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import json
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from _campaign import ROOT, Row, blind, campaign, explaining, options, rate
from _situation_drawing import DEVELOPMENT, FINAL, drawn
from _situation_labels import Experiment
from _situation_score import SCORED, Verdict, judged, verdict_of
from picktree.analysis.explain import explain, failure_fact, to_json_text
from picktree.analysis.explain.confidence import kind_of
from picktree.session import sources

COSTS = {"physics": 28.0, "kinematic": 10.0}
"""CPU seconds of a situation with its experiments, by backend, for the forecast."""
COST_ANEW = 3.0
"""CPU seconds of explaining a log again."""
LABELLED = "labelled"
"""Empty file in a situation's folder when its experiments are done."""
CELL = ("family", "mission", "scene", "robot", "backend")
"""Keys of a row that describe its cell."""
NICENESS = 19
KINDS_SHOWN = 15
"""Number of kinds of wrong and untold explanations that the report lists."""


@dataclass(frozen=True)
class Job:
    """Situation, and its explanation."""

    seed: int
    explains: str
    """Hash of the sources that explain."""


def one(job: Job, folder: Path) -> Row:
    """Run, label and explain a situation: the row of the results."""
    os.nice(NICENESS - os.nice(0))
    situation = drawn(job.seed)
    place = situation_folder(job.seed, folder.parent)
    place.mkdir(parents=True, exist_ok=True)
    experiment = Experiment(situation, place, folder.parent / f"cells-{_digest(sources())}")
    label, strikes = experiment.label(), experiment.strikes()
    (place / LABELLED).touch()
    cell = situation.cell
    whole = told(experiment.run)
    return {
        "family": cell.family,
        "mission": cell.mission["name"],
        "scene": cell.scene["base"],
        "robot": cell.robot,
        "backend": cell.backend,
        "cell_seed": cell.seed,
        "resumed": situation.resumed is not None,
        "deviations": [asdict(each) for each in situation.deviations],
        "entries": experiment.entries,
        "strikes": {str(each.number): asdict(each) for each in strikes},
        "targets": experiment.targets(),
        "label": asdict(label),
        "account": whole,
        "blind_account": told(experiment.run, truth=False) if takes_truth() else None,
        "log": str(experiment.run),
    }


def situation_folder(seed: int, logs: Path) -> Path:
    """Return the folder of a situation's run and outcomes: the same one whatever explains it."""
    return logs / f"situation-{seed}-{_digest((drawn(seed), sources()))}"


def _digest(of: object) -> str:
    return hashlib.sha256(repr(of).encode()).hexdigest()[:12]


def takes_truth() -> bool:
    """Return whether `explain` can leave out the ground truth."""
    return "truth" in inspect.signature(explain).parameters


def told(folder: Path, *, truth: bool = True) -> Row:
    """Return what `explain` says of a run, from a log without the events of its faults.

    `facts` has the outcome of each failure in the words of the labels.
    """
    with blind(folder) as run:
        rest = {} if truth else {"truth": False}
        found = json.loads(to_json_text(run, explain(run, faults=False, **rest)))
    keys = (
        "cause",
        "title",
        "item",
        "ended_run",
        "reasons",
        "failures",
        "time",
        "confidence",
        "items",
        "doubtful",
    )
    facts = [failure_fact(each["cause"], each["id"], each["item"]) for each in found["failures"]]
    return {
        "status": found["outcome"]["status"],
        "failures": len(found["failures"]),
        "facts": facts,
        "causes": [{key: each[key] for key in keys} for each in found["root_causes"]],
    }


def wanted(given: argparse.Namespace) -> list[Job]:
    """Return the jobs; with --backend those of one backend, as many as asked for."""
    of, explains = (FINAL if given.final else DEVELOPMENT), explaining()
    seeds = of[given.first : given.first + given.runs]
    return [
        Job(seed, explains)
        for seed in seeds
        if not given.backend or drawn(seed).cell.backend == given.backend
    ]


def scored(row: Row) -> Row:
    """Return the row with its verdicts."""
    if "crash" in row:
        return {**row, "verdict": "crash", "blind_verdict": None}
    blind_account = row["blind_account"]
    return {
        **row,
        "verdict": verdict_of(row, row["account"]),
        "blind_verdict": verdict_of(row, blind_account) if blind_account else None,
    }


def report(rows: Sequence[Row]) -> str:
    """Return the rates with their intervals, with and without truth."""
    lines = [f"{len(rows)} situations"]
    ran = [row for row in rows if row["verdict"] != "crash"]
    labels = Counter(row["label"]["status"] for row in ran)
    lines += [f"  {status}: {number}" for status, number in labels.most_common()]
    asked = [row for row in ran if row["label"]["status"] in ("cause", "undecided")]
    lines.append(rate("undecided", labels["undecided"], len(asked)))
    lines += ["", "With the ground truth", *_rates(ran, "verdict", "account")]
    if any(row["blind_verdict"] for row in ran):
        lines += ["", "Without it", *_rates(ran, "blind_verdict", "blind_account")]
    else:
        lines += ["", "Without it: not measured, `explain` takes no `truth`"]
    lines += ["", *_worst(ran)]
    lines += [f"crash: seed {row['seed']}: {row['crash']}" for row in rows if "crash" in row]
    return "\n".join(lines)


def _rates(rows: Sequence[Row], key: str, account: str) -> list[str]:
    known = [row for row in rows if row[key] in SCORED]
    lines = _counts(known, key)
    calm = [row for row in rows if row["label"]["status"] in ("clean", "harmless")]
    lines.append(rate("blamed, clean or harmless", sum(row[key] == "blamed" for row in calm), len(calm)))
    excluded = [row for row in rows if row["label"]["status"] == "no cause" and row["label"]["excluded"]]
    lines.append(rate("blamed though excluded", sum(row[key] == "blamed" for row in excluded), len(excluded)))
    stated: dict[str, list[bool]] = defaultdict(list)
    for row in known:
        cause = judged(row, row[account])
        if cause is not None:
            stated[cause["confidence"]].append(row[key] == "right")
    lines += ["", "right, by stated confidence"]
    lines += [rate(f"  {word}", sum(hits), len(hits)) for word, hits in sorted(stated.items())]
    groups: tuple[tuple[str, Callable[[Row], Iterable[str]]], ...] = (
        ("backend", lambda row: [row["backend"]]),
        ("robot", lambda row: [row["robot"]]),
        ("family", lambda row: [row["family"]]),
        ("number of causes", lambda row: [str(len({n for group in row["label"]["groups"] for n in group}))]),
        ("kind", lambda row: sorted({_kind(row, n) for group in row["label"]["groups"] for n in group})),
    )
    for title, of in groups:
        parts: dict[str, list[Row]] = defaultdict(list)
        for row in known:
            for part in of(row):
                parts[part].append(row)
        lines += ["", f"right, by {title}"]
        lines += [
            rate(f"  {part}", sum(row[key] == "right" for row in same), len(same))
            + f"; wrong {sum(row[key] == 'wrong' for row in same)}"
            for part, same in sorted(parts.items())
        ]
    return lines


def _counts(rows: Sequence[Row], key: str) -> list[str]:
    counts: Mapping[Verdict, int] = Counter(row[key] for row in rows)
    return [rate(verdict, counts.get(verdict, 0), len(rows)) for verdict in SCORED]


def _kind(row: Row, number: int) -> str:
    deviation = row["deviations"][number]
    return f"{deviation['where']} {deviation['kind']}"


def _worst(rows: Sequence[Row]) -> list[str]:
    """Return the most frequent pairs of a cause and what was said instead."""
    pairs: Counter[str] = Counter()
    seeds: dict[str, list[int]] = defaultdict(list)
    for row in rows:
        if row["verdict"] not in ("wrong", "untold", "partly"):
            continue
        true = ", ".join(sorted({_kind(row, n) for group in row["label"]["groups"] for n in group}))
        cause = judged(row, row["account"])
        pair = f"{row['verdict']}: {true}: {cause['cause'] if cause else 'nothing'}"
        pairs[pair] += 1
        seeds[pair].append(row["seed"])
    lines = ["Not right"]
    for pair, number in pairs.most_common(KINDS_SHOWN):
        lines.append(f"  {number} × {pair} (seeds {', '.join(map(str, seeds[pair][:5]))})")
    return lines


FIT = ROOT / "analysis" / "explain" / "confidence_fit.py"
"""Module with the fitted rates."""


def fit(rows: Iterable[Row]) -> Counter[tuple[str, bool, bool, bool]]:
    """Return the number of judged root causes by kind, doubt, use of the ground truth, and rightness."""
    found: Counter[tuple[str, bool, bool, bool]] = Counter()
    for row in rows:
        for key, account, truth in (("verdict", "account", True), ("blind_verdict", "blind_account", False)):
            cause = judged(row, row[account]) if row[key] in SCORED else None
            if cause is not None and not cause["confidence"].endswith("does not tell"):
                found[kind_of(cause["cause"]), cause["doubtful"], truth, row[key] == "right"] += 1
    return found


def fit_module(found: Counter[tuple[str, bool, bool, bool]]) -> str:
    """Return the source of the module with the fitted rates."""
    keys = sorted({key[:3] for key in found})
    head, _, tail = FIT.read_text(encoding="utf-8").partition("] = {")
    cells = [
        f"    {_literal(key)}: ({found[*key, True]}, {found[*key, True] + found[*key, False]}),\n"
        for key in keys
    ]
    return f"{head}] = {{\n{''.join(cells)}{tail[tail.index('}') :]}"


def _literal(key: tuple[str, bool, bool]) -> str:
    kind, doubtful, truth = key
    return f'("{kind}", {doubtful}, {truth})'


def shown(row: Row) -> str:
    """Return a situation for a reader."""
    lines = [
        f"seed {row['seed']}: {', '.join(row[key] for key in CELL)}"
        f"{', resumed' if row['resumed'] else ''}: {row['verdict']}; without truth {row['blind_verdict']}"
    ]
    entries = iter(row["entries"])
    for number, each in enumerate(row["deviations"]):
        what = next(entries) if each["where"] == "fault" else each["operations"]
        lines.append(
            f"  {number} {each['where']} {each['kind']}: {what}; struck {row['strikes'].get(str(number))}"
        )
    label = row["label"]
    lines.append(
        f"  label {label['status']}: causes {label['groups']}, excluded {label['excluded']}; {row['targets']}"
    )
    for cause in row["account"]["causes"]:
        mark = "→" if cause is judged(row, row["account"]) else " "
        lines.append(f"  {mark} [{cause['cause']}] {cause['confidence']}: {cause['title']} {cause['items']}")
    lines.append(f"  {row['log']}")
    return "\n".join(lines)


def main() -> int:
    parser = options(__file__, __doc__, runs=40, what="situations")
    parser.set_defaults(workers=1)
    parser.add_argument("--final", action="store_true", help="the seeds of the figure, to be drawn once")
    parser.add_argument("--backend", choices=("physics", "kinematic"), help="situations of one backend only")
    parser.add_argument(
        "--show", type=int, action="append", default=[], metavar="SEED", help="print a situation"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the scored rows there")
    parser.add_argument("--fit", action="store_true", help="write the rates of confidence into the package")
    given = parser.parse_args()
    if given.fit and given.final:
        parser.error("--fit takes development situations only")
    logs = given.out / "logs"

    def cost(job: Job) -> float:
        there = (situation_folder(job.seed, logs) / LABELLED).exists()
        return COST_ANEW if there else COSTS[drawn(job.seed).cell.backend]

    rows = campaign(given, wanted(given), one, cost=cost, short=_short)
    asked = [scored(row) for row in rows]
    if given.json:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(asked, ensure_ascii=False, indent=1))
    if given.fit:
        FIT.write_text(fit_module(fit(row for row in asked if row["verdict"] != "crash")), encoding="utf-8")
    chosen = [row for row in asked if row["seed"] in given.show]
    print("\n\n".join(map(shown, chosen)) if chosen else report(asked))
    return 0


def _short(row: Row) -> str:
    kinds = ", ".join(each["kind"] for each in row["deviations"]) or "nothing"
    cell = f"{row['family']}, {row['robot']}, {row['backend']}"
    return f"{cell}: {kinds}: {row['label']['status']}, {scored(row)['verdict']}"


if __name__ == "__main__":
    sys.exit(main())

"""Campaign: foreign arms, each made a robot by `picktree robot new`, tested, and let sort.

    nice python benchmarks/foreign_arms.py FOLDER
    nice python benchmarks/foreign_arms.py FOLDER --only xarm5_gripper --only tx2_60_hand

FOLDER/arms.tsv names the arms: columns `name`, `urdf` (a path from FOLDER, or `package:path`), `arguments` of
`robot new`, and `base` where somebody has moved one. FOLDER/bases.tsv (`name`, `base`) may say so instead:
three numbers, m. Robot files and results are written to FOLDER, or to that of --out.

Each arm that has a robot file sorts `sort_small` with `examples/sort_by_colour.yaml` for seeds 1 to 5. The
table has the self-test's verdict, sorted items, and the largest force on the hand, or the refusal.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from _campaign import ROOT, Row, campaign, options
from sorting import Job as SortingJob
from sorting import one as sort

SCENE, MISSION = "sort_small", ROOT / "examples" / "sort_by_colour.yaml"
SEEDS = range(1, 6)
COST = 200.0
"""CPU seconds of an arm, for the forecast."""
NEW_LIMIT = 1800.0
"""Longest time of `robot new` with its self-test, s."""
MIN_SHARE = 0.95
"""Least share of the items that a passing arm sorts."""


@dataclass(frozen=True)
class Job:
    name: str
    urdf: str
    arguments: str
    base: str
    """Numbers of the base's position, m; empty: that of the proposal."""
    out: str
    """Folder of results and robot files."""
    seed: int
    """Row of the table; the rows' order."""


def jobs_of(folder: Path, out: Path, only: list[str]) -> list[Job]:
    """Return the arms of a folder's table. Ends the program without one."""
    rows, bases = _table(folder / "arms.tsv"), dict[str, str]()
    if (folder / "bases.tsv").exists():
        bases = {row["name"]: row["base"] for row in _table(folder / "bases.tsv")}
    return [
        Job(
            row["name"],
            row["urdf"] if ":" in row["urdf"] else str(folder / row["urdf"]),
            row.get("arguments") or "",
            bases.get(row["name"], row.get("base") or ""),
            str(out),
            number,
        )
        for number, row in enumerate(rows)
        if not only or row["name"] in only
    ]


def _table(file: Path) -> list[dict[str, str]]:
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise SystemExit(f"{file}: {error.strerror}") from None
    return list(csv.DictReader(text.splitlines(), delimiter="\t"))


def one(job: Job, folder: Path) -> Row:
    """Make a robot file of one arm, test it, and sort with it; the row has what came of each step."""
    file = Path(job.out) / "robots" / f"{job.name}.yaml"
    file.parent.mkdir(exist_ok=True)
    file.unlink(missing_ok=True)
    arguments = shlex.split(job.arguments)
    made = _picktree("robot", "new", job.urdf, *arguments, "-o", str(file), "--json")
    if made.returncode:
        return {"name": job.name, "refused": made.stderr.strip()}
    summary = json.loads(made.stdout)
    test = summary["test"]
    if job.base:
        at = ", ".join(re.split(r"[,\s]+", job.base.strip()))
        text = re.sub(r"(?m)^base: .*$", f"base: {{at: [{at}]}}", file.read_text(encoding="utf-8"))
        file.write_text(text, encoding="utf-8")
        test = json.loads(_picktree("robot", "test", str(file), "--json").stdout)
    runs: list[Row] = []
    for seed in SEEDS:
        try:
            runs.append(sort(SortingJob(str(MISSION), SCENE, seed, False, None, str(file)), folder))
        except Exception as error:  # noqa: BLE001  whatever fails is counted
            runs.append({"crash": f"{type(error).__name__}: {error}"})
    return {
        "name": job.name,
        "joints": len(summary["joints"]),
        "opening": summary["opening"],
        "hand": summary["hand"],
        "verdicts": test["verdicts"],
        "runs": runs,
    }


def _picktree(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "picktree", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=NEW_LIMIT,
    )


def sorted_items(row: Row) -> tuple[int, int]:
    """Return the number of sorted items and of all items in an arm's runs that did not crash."""
    counts = [run["result"]["items"] for run in row.get("runs", ()) if "result" in run]
    return sum(count["sorted"] for count in counts), sum(count["total"] for count in counts)


def passes(row: Row) -> bool:
    """Return whether an arm passes its self-test and sorts MIN_SHARE of the items without a crash."""
    done, total = sorted_items(row)
    good = all(verdict["good"] for verdict in row.get("verdicts", [{"good": False}]))
    return good and not any("crash" in run for run in row["runs"]) and done >= MIN_SHARE * total > 0.0


def line(row: Row) -> str:
    """Return the row of an arm in the Markdown table."""
    if "refused" in row or "crash" in row:
        told = " ".join(str(row.get("refused") or row["crash"]).split()).replace("|", "\\|")
        return f"| {row['name']} | | | refused: {told} | | |"
    failed = [verdict["name"] for verdict in row["verdicts"] if not verdict["good"]]
    verdict = f"failed: {', '.join(failed)}" if failed else f"all {len(row['verdicts'])} passed"
    done, total = sorted_items(row)
    crashed = sum("crash" in run for run in row["runs"])
    items = f"{done} of {total}" + (f", {crashed} runs crashed" if crashed else "")
    force = max((run["force"] for run in row["runs"] if "force" in run), default=0.0)
    gripper = f"{row['hand']}, {1000 * row['opening']:.0f} mm"
    return f"| {row['name']} | {row['joints']} | {gripper} | {verdict} | {items} | {force:.1f} N |"


def report(rows: list[Row]) -> str:
    """Return the Markdown table, and the number of arms that pass."""
    lines = [
        "| arm | joints | gripper | self-test | items sorted | largest force |",
        "|---|---|---|---|---|---|",
        *map(line, rows),
        "",
        f"{sum(map(passes, rows))} of {len(rows)} arms pass the self-test and sort at least "
        f"{100 * MIN_SHARE:.0f} % of the items.",
    ]
    return "\n".join(lines)


def parser() -> argparse.ArgumentParser:
    found = options(__file__, __doc__, runs=None, what="(as many as the table has)")
    found.add_argument("folder", type=Path, help="folder with arms.tsv")
    found.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="only this arm; repeatable"
    )
    return found


def main() -> int:
    given = parser().parse_args()
    given.out = given.out or given.folder
    given.workers = given.workers or 1
    jobs = jobs_of(given.folder.absolute(), given.out.absolute(), given.only)
    rows = campaign(given, jobs, one, cost=COST, short=lambda row: line(row))
    for job in jobs:
        for row in rows:
            if row["seed"] == job.seed:
                row.setdefault("name", job.name)
    print(report(rows))
    return 0 if all(map(passes, rows)) else 1


if __name__ == "__main__":
    sys.exit(main())

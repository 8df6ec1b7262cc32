"""Whether a batch comes to the same table however often everything is killed.

One batch runs undisturbed. Another of the same jobs is ended by kill -9 of all its processes at random
moments, and resumed each time, until the kills are done; then it runs to its end. The results of both must
be equal in every table, apart from the time that things took and the revision of a checkout that somebody
commits to meanwhile; no job may be recorded twice, none may be lost, and no file may be left that the
undisturbed batch does not have.

Tries that a kill broke off do not count as attempts: a try counts when it came to an end of its own.

python benchmarks/batch_kills.py --kills 10 --runs 40
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

from _campaign import REFERENCE_COST, RESULTS, ROOT, reference

COST = {"physics": 7.0, "kinematic": 2.0}
"""CPU seconds that a run of `sort_small` takes, for the forecast."""
TAKES_TIME = {"jobs": {"cpu_seconds", "wall_seconds"}}
"""Columns that differ between any two runs of the same jobs."""
STAMP = re.compile(r"-\d{8}-\d{6}")
"""Time stamp in the name of a run's folder."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--backend", choices=("physics", "kinematic"), default="kinematic")
    parser.add_argument("--mission", default=str(ROOT / "examples" / "sort_by_colour.yaml"))
    parser.add_argument("--scene", default="sort_small")
    parser.add_argument("--keep", choices=("all", "failures", "none"), default="failures")
    parser.add_argument("--out", default=str(RESULTS / "batch_kills"))
    chosen = parser.parse_args()
    cost = 2.5 * chosen.runs * COST[chosen.backend] + 12.0 * chosen.kills
    cost *= reference() / REFERENCE_COST
    print(f"about {cost / 60:.0f} CPU minutes on {chosen.workers} workers", flush=True)
    out = Path(chosen.out)
    shutil.rmtree(out, ignore_errors=True)
    command = [
        *(sys.executable, "-m", "picktree", "batch", "run", "--mission", chosen.mission),
        *("--scene", chosen.scene, "--seeds", f"0:{chosen.runs}", "--backend", chosen.backend),
        *("--keep", chosen.keep, "--workers", str(chosen.workers)),
    ]
    began = time.monotonic()
    finish([*command, "--out", str(out / "undisturbed")])
    took = time.monotonic() - began
    print(f"undisturbed: {chosen.runs} jobs in {took:.0f} s", flush=True)
    killed_at(out / "killed", command, chosen.kills, took, random.Random(chosen.seed))
    wrong = [*differences(out / "undisturbed", out / "killed"), *twice(out / "killed")]
    print("\n".join(wrong) or "the tables are equal, no job is there twice, no file is left over")
    return 1 if wrong else 0


def finish(command: list[str]) -> None:
    code = subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode
    if code not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: exit code {code}")


def killed_at(folder: Path, command: list[str], kills: int, took: float, rng: random.Random) -> None:
    """Begin, kill, resume and kill; then run to the end."""
    made = 0
    while made < kills:
        begun = (folder / "plan.json").exists()
        process = subprocess.Popen(
            [*command[:5], "--resume", str(folder), "--workers", command[-1]]
            if begun
            else [*command, "--out", str(folder)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        # Half of the moments are anywhere in what a batch takes, half are while it loads or has just begun.
        moment = rng.uniform(0.0, took / 3) if made % 2 else rng.uniform(0.0, min(12.0, took))
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            count = kill_everything(process.pid)
            made += 1
            print(f"kill {made}: after {moment:.1f} s, {count} processes; {standing(folder)}", flush=True)
        errors = process.communicate()[1].decode()
        if process.returncode == 2 and "no batch" not in errors:
            raise SystemExit(errors)
        if process.returncode in (0, 1):
            print(f"it was done before kill {made + 1}: take more runs", flush=True)
            break
    finish([*command[:5], "--resume", str(folder), "--workers", command[-1]])


def kill_everything(pid: int) -> int:
    """The process and all below it; how many those were."""
    found = [pid]
    for each in found:
        for children in Path(f"/proc/{each}/task").glob("*/children"):
            try:
                found += map(int, children.read_text().split())
            except OSError:
                continue
    for each in found:
        try:
            os.kill(each, signal.SIGKILL)
        except ProcessLookupError:
            continue
    return len(found)


def standing(folder: Path) -> str:
    if not (folder / "results.sqlite").exists():
        return "no results yet"
    with sqlite3.connect(folder / "results.sqlite") as results:
        return ", ".join(
            f"{count} {status}"
            for status, count in results.execute("SELECT status, count(*) FROM jobs GROUP BY status")
        )


def differences(a: Path, b: Path) -> list[str]:
    """Rows that only one of them has, and files that only one of them has."""
    wrong: list[str] = []
    tables = contents(a)
    others = contents(b)
    for name in sorted({*tables, *others}):
        if tables.get(name) != others.get(name):
            missing = (tables.get(name, Counter()) - others.get(name, Counter())).most_common(2)
            more = (others.get(name, Counter()) - tables.get(name, Counter())).most_common(2)
            wrong.append(f"table {name} differs: missing {missing}, too many {more}")
    files, other = listing(a), listing(b)
    if files != other:
        wrong.append(f"files missing: {sorted(files - other)[:5]}; left over: {sorted(other - files)[:5]}")
    return wrong


def contents(folder: Path) -> dict[str, Counter[tuple[object, ...]]]:
    found: dict[str, Counter[tuple[object, ...]]] = {}
    with sqlite3.connect(folder / "results.sqlite") as results:
        names = [
            name
            for (name,) in results.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
        ]
        for name in names:
            columns = [row[1] for row in results.execute(f"PRAGMA table_info({name})")]
            kept = [column for column in columns if column not in TAKES_TIME.get(name, ())]
            which = "WHERE library <> 'revision'" if name == "versions" else ""
            rows = results.execute(f"SELECT {', '.join(kept)} FROM {name} {which}")
            found[name] = Counter(
                tuple(STAMP.sub("", cell) if isinstance(cell, str) else cell for cell in row) for row in rows
            )
    return found


def listing(folder: Path) -> set[str]:
    return {
        STAMP.sub("", str(path.relative_to(folder)))
        for path in folder.rglob("*")
        if path.name not in ("results.sqlite-wal", "results.sqlite-shm")
    }


def twice(folder: Path) -> list[str]:
    with sqlite3.connect(folder / "results.sqlite") as results:
        found = results.execute("SELECT job, count(*) FROM jobs GROUP BY job HAVING count(*) > 1").fetchall()
        undone = results.execute("SELECT count(*) FROM jobs WHERE status = 'waiting'").fetchone()[0]
    wrong = [f"job {job} is there {count} times" for job, count in found]
    return [*wrong, f"{undone} jobs were not run"] if undone else wrong


if __name__ == "__main__":
    sys.exit(main())

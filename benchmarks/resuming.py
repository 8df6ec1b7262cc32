"""Missions that are killed (SIGKILL, a process of their own) at random moments and go on, both ways: from the
last checkpoint, and as things stood.

Each run is compared with the same mission, scene and seed left alone: it has to finish with as many items
sorted; from the checkpoint with the same digest, too. A run may be killed several times. Each job has both
ways.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

from _campaign import ROOT, Row, campaign, finished, options, rate, seeds
from picktree.files import PicktreeError
from picktree.logs import RunLog

EXAMPLES = ROOT / "examples"
CASES = (
    ("sort_by_colour.yaml", "sort_small"),
    ("sort_by_colour.yaml", "three_bins"),
    ("sort_by_colour.yaml", "tumbled"),
)
"""Mission and scene, in turn."""
KILLS = 2
"""Maximum number of kills of one run; the first always comes."""
COST = 75.0
"""CPU seconds of a job: three runs, and what is done again."""
LONGEST = 1800.0
"""Wall seconds that a run may take."""


@dataclass(frozen=True)
class Job:
    seed: int
    backend: str

    @property
    def case(self) -> tuple[str, str]:
        return CASES[self.seed % len(CASES)]


def one(job: Job, out: Path) -> Row:
    """All runs of a job; a row of the results."""
    mission, scene = job.case
    begun = time.process_time() + _children()
    start = [str(EXAMPLES / mission), "--scene", scene, "--seed", str(job.seed), "--backend", job.backend]
    alone, seconds, _ = _run(start, out / "alone", None)
    assert alone is not None, "nobody killed it"
    ways: dict[str, Any] = {}
    for way, more in (("checkpoint", []), ("stands", ["--as-it-stands"])):
        chance = random.Random(f"{job.seed} {way}")
        ways[way] = _killed(start, more, out / way, seconds, chance)
        shutil.rmtree(out / way)
    shutil.rmtree(out / "alone")
    return {
        "scene": scene,
        "alone": _short(alone),
        "ways": ways,
        "cpu": time.process_time() + _children() - begun,
    }


def _killed(start: list[str], options: list[str], out: Path, seconds: float, chance: random.Random) -> Row:
    """A run that is killed, once or more, and goes on until it ends."""
    kills: list[float] = []
    command, folder = start, out / "0"
    while True:
        more = len(kills) < KILLS and (not kills or chance.random() < 0.5)
        after = chance.uniform(0.05, 0.85) * seconds if more else None
        result, _, said = _run(command, folder, after)
        if result is not None:
            if not kills and after is not None:
                seconds *= 0.7  # it was faster than it: once more, and earlier
                folder = folder.with_name(f"{folder.name}-again")
                continue
            return {**_short(result), "kills": kills, "said": said[-400:]}
        log = next(folder.iterdir(), None) if folder.is_dir() else None
        if log is None or not (log / "log.mcap").exists():
            return {
                "status": "nothing to go on with",
                "kills": kills,
                "sorted": -1,
                "digest": "",
                "said": said[-400:],
            }
        kills.append(_end_of(log))
        command, folder = ["--resume", str(log), *options], out / str(len(kills))
        if len(kills) > KILLS:
            return {
                "status": "it ended without a result",
                "kills": kills,
                "sorted": -1,
                "digest": "",
                "said": said,
            }


def _run(arguments: Sequence[str], out: Path, kill_after: float | None) -> tuple[Row | None, float, str]:
    """The result, None when it was killed or has none; how long it took from when it was built, wall s; what
    it said. `kill_after`: wall seconds from then."""
    command = [sys.executable, "-m", "picktree", "run", *arguments, "--out", str(out), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said: list[str] = []
    for line in cast("IO[str]", process.stderr):
        said.append(line)
        if line.startswith("recording to"):
            break
    begun = time.perf_counter()
    try:
        answer, rest = process.communicate(timeout=LONGEST if kill_after is None else kill_after)
    except subprocess.TimeoutExpired:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
        return None, time.perf_counter() - begun, "".join(said)
    text = "".join(said) + rest
    return (json.loads(answer) if answer else None), time.perf_counter() - begun, text


def _end_of(log: Path) -> float:
    try:
        with RunLog(log) as read:
            return round(read.end, 2)
    except PicktreeError:
        return -1.0


def _short(result: Row) -> Row:
    items = result["items"]
    return {
        "status": result["status"],
        "sorted": items["sorted"],
        "total": items["total"],
        "digest": result["digest"],
        "seconds": result["sim_seconds"],
    }


def _children() -> float:
    times = os.times()
    return times.children_user + times.children_system


def _told(row: Row) -> str:
    alone, ways = row["alone"], row["ways"]
    parts = [
        f"{name} {way['status']} {way['sorted']}, killed at {way['kills']}" for name, way in ways.items()
    ]
    return f"{row['scene']}, alone {alone['status']} {alone['sorted']}; {'; '.join(parts)}"


def main() -> int:
    parser = options(__file__, __doc__, runs=30)
    parser.add_argument("--backend", choices=("physics", "kinematic"), default="physics")
    given = parser.parse_args()
    jobs = [Job(seed, given.backend) for seed in seeds(given)]
    rows = finished(campaign(given, jobs, one, cost=COST, short=_told))
    print()
    for way, words in (("checkpoint", "from the checkpoint"), ("stands", "as things stood")):
        done = [(row["alone"], row["ways"][way]) for row in rows]
        n, kills = len(done), sum(len(now["kills"]) for _, now in done)
        print(f"{words}: {kills} kills in {n} missions")
        ended = sum(now["status"] in ("success", "incomplete", "failure") for _, now in done)
        print("  " + rate("finished", ended, n))
        print("  " + rate("as many items sorted", sum(a["sorted"] == b["sorted"] for a, b in done), n))
        print("  " + rate("at least as many", sum(b["sorted"] >= a["sorted"] for a, b in done), n))
        if way == "checkpoint":
            print("  " + rate("the same digest", sum(a["digest"] == b["digest"] for a, b in done), n))
        longer = [b["seconds"] - a["seconds"] for a, b in done if "seconds" in b]
        if longer:
            print(
                f"  simulated time beyond that of the run alone: {sum(longer) / len(longer):.1f} s a mission"
            )
    print(f"CPU {sum(row['cpu'] for row in rows) / max(1, len(rows)):.0f} s a job")
    return 0


if __name__ == "__main__":
    sys.exit(main())

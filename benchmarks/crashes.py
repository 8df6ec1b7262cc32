"""Whether a recorder loses anything when it dies.

Moments: a real run is recorded, step by step; the file of each of many moments, within writes too, is opened
with the mcap package's reader and with ours, and must hold everything but the last simulated second.

Kills: real runs are ended by kill -9 at random moments, half of them while a tick takes 2.5 s; each log must
open in the mcap package's reader and hold every tick that was over a second of the wall before.

python benchmarks/crashes.py --prefixes 10000 --kills 100
"""

from __future__ import annotations

import argparse
import mmap
import os
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

from _tape import Opened, open_moment, opens_in_stock_reader, taped
from picktree.logs import RunLog
from picktree.session import Observer, RunRequest, Session
from picktree.world import Tick

MISSION = Path(__file__).resolve().parent.parent / "examples" / "sort_by_colour.yaml"
SHARED = Path("/dev/shm") if Path("/dev/shm").is_dir() else Path(tempfile.gettempdir())
PROGRESS = struct.Struct("<dd")
"""Of each tick: simulated time, wall time when it was over."""
CAPACITY = 4000
STALL_AT, STALL = 120, 2.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--prefixes", type=int, default=10_000, help="moments of a recorded run")
    parser.add_argument("--kills", type=int, default=100, help="processes that are killed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--child", nargs=3, metavar=("FOLDER", "PROGRESS", "STALL"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.child:
        child(Path(chosen.child[0]), Path(chosen.child[1]), stall=chosen.child[2] == "1")
        return
    print(
        f"about {chosen.prefixes * 0.05 / 60:.0f} CPU minutes for the moments and "
        f"{chosen.kills * 6 / 60:.0f} for the kills, two at a time",
        flush=True,
    )
    with tempfile.TemporaryDirectory(dir=SHARED) as folder:
        if chosen.prefixes:
            moments(Path(folder), chosen.prefixes, random.Random(chosen.seed))
        if chosen.kills:
            kills(Path(folder), chosen.kills, random.Random(chosen.seed))


def moments(folder: Path, count: int, rng: random.Random) -> None:
    request = RunRequest(MISSION, scene="sort_small", seed=1, backend="kinematic", out=folder)
    with taped() as tape:
        result = Session(request).run()
    print(
        f"a run of {result.sim_seconds:.1f} s: {len(tape.handed)} messages, {len(tape.steps)} writes and "
        f"seeks, {tape.length} moments, the file has its name from {tape.published}"
    )
    if tape.handed[0].length > tape.published or tape.must_hold(tape.published):
        raise SystemExit("messages were taken long before there was a file")
    between = [m for m in accumulate(step.length for step in tape.steps) if m >= tape.published]
    chosen = sorted(
        rng.choice(between) if rng.random() < 0.1 else rng.randint(tape.published, tape.length)
        for _ in range(count)
    )
    found: list[Opened] = []
    began = time.process_time()
    for moment, data in tape.states(chosen):
        found.append(open_moment(tape, moment, data, folder / "moment.mcap"))
    lost = [opened.lost for opened in found]
    print(
        f"{count} moments: all open with everything but the last second or less; "
        f"{sum(o.stock for o in found)} in the stock reader, {sum(o.recovered for o in found)} recovered; "
        f"messages lost: {sum(lost) / count:.0f} in the mean, {max(lost)} at most "
        f"({time.process_time() - began:.0f} s)",
        flush=True,
    )


class Progress(Observer):
    """Tells another process how far the run is: memory survives who wrote it."""

    def __init__(self, path: Path, *, stall: bool) -> None:
        with path.open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), 0)
        self._count = 0
        self._stall = stall

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        PROGRESS.pack_into(self._memory, 8 + self._count * PROGRESS.size, now, time.monotonic())
        self._count += 1
        self._memory[:8] = self._count.to_bytes(8, "little")
        if self._stall and self._count == STALL_AT:
            time.sleep(STALL)


def child(folder: Path, progress: Path, *, stall: bool) -> None:
    request = RunRequest(MISSION, scene="sort_small", seed=1, backend="kinematic", out=folder)
    Session(request, observers=[Progress(progress, stall=stall)]).run()


@dataclass(frozen=True, slots=True)
class Killed:
    ticks: int
    """That were over when the process was killed."""
    lost: int
    """Of them, how many the log does not hold."""
    age: float
    """Wall seconds from the end of the first lost one to the kill; 0 when none is lost."""
    stock: bool
    finished: bool


def kills(folder: Path, count: int, rng: random.Random) -> None:
    delays = [rng.uniform(0.0, 3.0) for _ in range(count)]

    def one(number: int) -> Killed:
        return kill(folder / f"kill-{number}", number % 2 == 0, delays[number])

    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(one, range(count)))
    done = Counter(killed.finished for killed in found)
    hurt = [killed for killed in found if not killed.finished]
    print(
        f"{count} kills, {done[True]} after the end of the run; {sum(k.stock for k in found)} open in the "
        f"stock reader; ticks lost: {sum(k.lost for k in hurt) / max(len(hurt), 1):.1f} in the mean, "
        f"{max((k.lost for k in hurt), default=0)} at most, the oldest of them "
        f"{max((k.age for k in hurt), default=0.0):.2f} s before the kill"
    )
    if max((k.age for k in hurt), default=0.0) > 1.0:
        raise SystemExit("more than the last second is lost")


def kill(folder: Path, stall: bool, delay: float) -> Killed:
    folder.mkdir()
    progress = folder / "progress"
    progress.write_bytes(bytes(8 + CAPACITY * PROGRESS.size))
    arguments = [sys.executable, __file__, "--child", str(folder), str(progress), str(int(stall))]
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    with progress.open("rb") as file:
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    while memory[:8] == bytes(8) and process.poll() is None:
        time.sleep(0.002)
    time.sleep(delay)
    at = time.monotonic()
    os.kill(process.pid, signal.SIGKILL)
    errors = process.communicate()[1]
    if process.returncode not in (0, -signal.SIGKILL):
        raise SystemExit(errors.decode())
    ticks = int.from_bytes(memory[:8], "little")
    over = [PROGRESS.unpack_from(memory, 8 + k * PROGRESS.size) for k in range(ticks)]
    path = next(folder.glob("*/log.mcap"))
    stock = opens_in_stock_reader(path)
    with RunLog(path) as log:
        held = {round(at.time / 0.05) for at in log.ticks()}
        finished = bool(log.result)
        assert finished == (process.returncode == 0) or len(held) >= ticks
        log.tree()
    lost = [(now, wall) for now, wall in over if round(now / 0.05) not in held]
    age = at - lost[0][1] if lost else 0.0
    return Killed(ticks, len(lost), age, stock, finished)


if __name__ == "__main__":
    main()

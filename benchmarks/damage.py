"""What comes of damaged logs: each is one clear error, or is read but for what it says is lost.

Files are cut, flipped, zeroed, made longer, given wrong lengths and so on; each is read in full, and one
command is carried out on it.

python benchmarks/damage.py --files 1000
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import tempfile
import time
from collections import Counter
from pathlib import Path

from _damage import KINDS, Whole, commanded, opened
from picktree.session import RunRequest, Session

MISSION = Path(__file__).resolve().parent.parent / "examples" / "one_pick.yaml"
SHARED = Path("/dev/shm") if Path("/dev/shm").is_dir() else Path(tempfile.gettempdir())
SLOWEST = 30.0
"""CPU seconds within which everything must have been said."""
MEMORY = 4 << 30
"""Bytes that the process may take; more is a MemoryError."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--files", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands-every", type=int, default=1, help="a command on each so-and-so-many-th")
    chosen = parser.parse_args()
    cost = chosen.files * (0.06 + 0.6 / chosen.commands_every) / 60
    print(f"about {cost:.0f} CPU minutes", flush=True)
    with Path(os.devnull).open() as nobody:
        os.dup2(nobody.fileno(), 0)  # who asks for commands gets none
    rng = random.Random(chosen.seed)
    kinds: Counter[str] = Counter()
    codes: Counter[tuple[str, int]] = Counter()
    silent: Counter[str] = Counter()
    slowest = 0.0
    with tempfile.TemporaryDirectory(dir=SHARED) as name:
        folder = Path(name)
        request = RunRequest(MISSION, seed=1, backend="kinematic", out=folder)
        whole = Whole.of(Session(request).run().log)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        path = folder / "damaged.mcap"
        for number in range(chosen.files):
            damage = KINDS[number % len(KINDS)]
            data = bytes(damage(bytearray(whole.data), rng))
            if data == whole.data:
                continue
            path.write_bytes(data)
            began = time.process_time()
            try:
                said = opened(path, whole)
                arguments, answered = _command(rng, path, folder), None
                if number % chosen.commands_every == 0:
                    answered = commanded(arguments, frozenset({0, 1, 2}))
            except Exception:
                kept = Path(tempfile.gettempdir()) / "damaged.mcap"
                kept.write_bytes(data)
                print(f"file {number}, {damage.__name__}: kept as {kept}")
                raise
            slowest = max(slowest, time.process_time() - began)
            read = "the rest is whole" in said or "recovered up to byte" in said
            kinds["read but for what is lost" if read else "an error"] += 1
            if answered is not None:
                codes[arguments[0], answered.code] += 1
                if answered.code != 2 and not answered.told:
                    silent[arguments[0]] += 1
            if slowest > SLOWEST:
                raise SystemExit(f"file {number}, {damage.__name__}: {slowest:.0f} s")
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{sum(kinds.values())} files: {dict(kinds)}")
    for (command, code), count in sorted(codes.items()):
        print(f"  {command}: exit {code}: {count}")
    print(f"commands that do not repeat what is lost: {dict(silent) or 'none'}")
    print(f"slowest {slowest:.1f} s; memory {before / 1024:.0f} MB before, {after / 1024:.0f} MB at most")


def _command(rng: random.Random, path: Path, folder: Path) -> list[str]:
    log = str(path)
    if rng.random() < 0.1:  # these take long
        film = [str(folder / "film.gif"), "--to", "0.2", "--size", "160x100", "--processes", "1"]
        return rng.choice(
            [
                ["resim", log],
                ["whatif", log, "--at", "3.0s", "--out", str(folder)],
                ["video", log, "-o", *film],
            ]
        )
    return rng.choice(
        [
            ["snapshot", log, "--at", "1.0", "-o", str(folder / "picture.png")],
            ["explain", log],
            ["explain", log, "--json"],
            ["replay", log],
            ["layout", log, "-o", str(folder / "layout.json")],
            ["diff", log, log],
            ["export", log, "--to", "csv", "-o", str(folder / "tables")],
            ["report", log, "-o", str(folder / "report.html")],
        ]
    )


if __name__ == "__main__":
    main()

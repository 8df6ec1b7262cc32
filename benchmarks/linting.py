"""The linter against reality, on many random missions: nothing may happen that its analysis rules out.

python benchmarks/linting.py [--missions 5000] [--runs 6] [--first 0] [--workers 2]

Each mission is written from its seed over the whole vocabulary, analysed, and run with leaves that do as they
like within what they declare. Every end of every node is held against the analysis: its status and cause, the
keys that are written, what the hand holds. A key that was unwritten when it was read must have been named;
a node that is called unreachable is never ticked, a handler that is called needless never used. Exit 1 when
something happened that was ruled out.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from picktree.authoring.lint import lint


@dataclass
class Share:
    """What came of some of the missions."""

    ends: Counter[str] = field(default_factory=Counter[str])
    findings: Counter[str] = field(default_factory=Counter[str])
    wrong: list[str] = field(default_factory=list[str])
    nodes: int = 0
    seconds: float = 0.0
    """CPU time of the linter."""


def share(first: int, last: int, runs: int) -> Share:
    from ..tests.authoring.watched import Watched
    from ..tests.authoring.wild_missions import wild_mission

    found = Share()
    for seed in range(first, last):
        watched = Watched(wild_mission(seed))
        began = time.process_time()
        found.findings.update(fault.code for fault in lint(watched.mission))
        found.seconds += time.process_time() - began
        found.nodes += sum(1 for tree in watched.mission.trees.values() for _ in tree.root.iterate())
        for run in range(runs):
            ended = watched.run(run)
            if ended.unsound:
                found.wrong.append(f"mission {seed}, run {run}: {ended.unsound}")
                break
            found.ends[ended.status.value] += 1
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--missions", type=int, default=5000)
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    last, step = options.first + options.missions, 50
    starts = range(options.first, last, step)
    total = Share()
    with ProcessPoolExecutor(options.workers) as pool:
        ends = [min(start + step, last) for start in starts]
        for part in pool.map(share, starts, ends, [options.runs] * len(starts)):
            total.ends += part.ends
            total.findings += part.findings
            total.wrong += part.wrong
            total.nodes += part.nodes
            total.seconds += part.seconds
    for sentence in total.wrong:
        print(sentence)
    print(f"{options.missions} missions of {total.nodes} nodes, {sum(total.ends.values())} runs: ", end="")
    print(", ".join(f"{count} {status}" for status, count in sorted(total.ends.items())))
    print("findings: " + ", ".join(f"{code} {count}" for code, count in sorted(total.findings.items())))
    print(f"linter: {total.seconds / options.missions * 1000:.1f} ms CPU a mission")
    print(f"{len(total.wrong)} times something happened that had been ruled out")
    return 1 if total.wrong else 0


if __name__ == "__main__":
    sys.exit(main())

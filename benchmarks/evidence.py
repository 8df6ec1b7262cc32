"""Evidence: run the campaigns of evidence.yaml within a given time, and write docs/figures.md from them.

    python benchmarks/evidence.py --hours 2           # make campaign HOURS=2
    python benchmarks/evidence.py --list              # what would be run, in which order
    python benchmarks/evidence.py --only tote,pile --hours 0.5
    python benchmarks/evidence.py --page              # run nothing, write the page

Campaigns without a figure come first, then those of which a file that their runs depended on has changed
since, oldest first, then those with the widest interval. Old ones of which some runs were repeated with what
has changed, and all came out the same, come after the other old ones. Of each the page says how many were
repeated, with which commit, and how many came out the same. Each gets an equal share of the time that is
left and goes on where it stopped. The rows of its runs are part of the checkout, and of the soak its diary
and its last moment; the fault campaign needs its logs. What it printed is kept in evidence.json with commit
and date. A result that still holds, or of which repeated runs came out the same, is not replaced by one of
fewer runs, and another old one not by one that counts less than a quarter of it.
"""

from __future__ import annotations

import argparse
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Sequence
from datetime import UTC, datetime

from _campaign import ROOT
from _campaign_results import commits
from _dependencies import Dependencies, of_program
from _evidence import Campaign, Record, campaigns, in_order, read, to_page, with_contents, write
from picktree.session.environment import revision

PAGE = ROOT / "docs" / "figures.md"
LEAST_MINUTES = 3.0
"""Share of the time that a campaign gets at least, while there is some, minutes."""
SHORTEST = 0.1
"""Time below which no campaign is begun, minutes."""


def run(one: Campaign, minutes: float) -> Record | None:
    """Run a campaign for so long; return its result, or None when it has none yet."""
    program, *words = shlex.split(one.line)[1:]
    print(f"\n== {one.name}: {one.line}, {minutes:.0f} min", file=sys.stderr, flush=True)
    given = [sys.executable, program, *words, "--out", str(one.folder), "--minutes", f"{minutes:.2f}"]
    done = subprocess.run(given, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 1) or not done.stdout.strip():  # 1: a target of its own is missed
        print(f"   no result (exit code {done.returncode})", file=sys.stderr, flush=True)
        return None
    files = Dependencies(one.folder).files or of_program(one.program)
    commit = ", ".join(commits(one.folder)) or revision()
    date, text = f"{datetime.now(UTC):%Y-%m-%d %H:%M}", done.stdout.strip("\n")
    return Record(commit, date, text, with_contents(files))


def _state(record: Record | None) -> str:
    if record is None:
        return "no figure yet"
    return "old" if record.changed else "up to date"


def _shares(waiting: Sequence[Campaign], hours: float) -> Generator[tuple[Campaign, float]]:
    """Deal the time out, in minutes: what one leaves is shared by those that follow."""
    until = time.monotonic() + 3600 * hours
    for number, one in enumerate(waiting):
        left = (until - time.monotonic()) / 60
        if left < SHORTEST:
            print(f"no time is left for {', '.join(each.name for each in waiting[number:])}", file=sys.stderr)
            return
        yield one, min(left, max(LEAST_MINUTES, left / (len(waiting) - number)))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=2.0, help="wall time for all; 2 unless given")
    parser.add_argument("--only", default="", metavar="NAMES", help="only these, separated by commas")
    parser.add_argument("--list", action="store_true", help="run nothing: say the order")
    parser.add_argument("--page", action="store_true", help="run nothing: write the page")
    given = parser.parse_args()
    table, records = campaigns(), read()
    names = [name for name in given.only.split(",") if name]
    if unknown := set(names) - {one.name for one in table}:
        parser.error(
            f"no campaign {', '.join(sorted(unknown))}; there are {', '.join(c.name for c in table)}"
        )
    waiting = in_order([one for one in table if not names or one.name in names], records)
    if given.list:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # ends in silence before `| head`
        for one in waiting:
            print(f"{one.name:<34} {_state(records.get(one.name)):<14} {one.line}")
        return 0
    if not given.page:
        for one, minutes in _shares(waiting, given.hours):
            record = run(one, minutes)
            known = records.get(one.name)
            if record is not None and record.replaces(known, alike=one.alike(known)):
                records[one.name] = record
                write(records)
                PAGE.write_text(to_page(table, records), encoding="utf-8")
    PAGE.write_text(to_page(table, records), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)} is written", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())

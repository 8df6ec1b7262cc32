"""Function calls of a few fixed runs and commands, recorded in `calls.json`: effort that no machine changes.

    python tests/golden/calls.py            # counts them, as one JSON object
    python tests/golden/calls.py --write    # records the counts again: `make calls`

A count that has grown by more than 5 % is recorded only when the section Unreleased of CHANGELOG.md has a
line with the run and its new count. Growth is counted from the smallest count since then.

Each is done twice in this process, and the second time is counted: by then imports are over and caches are
full. Calls are those of Python functions and of C functions from Python, on the main thread. The clock of the
log stands still and garbage is not collected meanwhile, so that counts do not depend on the machine's speed.
"""

from __future__ import annotations

import argparse
import cProfile
import gc
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RECORD = HERE / "calls.json"
CHANGELOG = ROOT / "CHANGELOG.md"
OF_LIBRARIES = "libraries"
"""Name under which calls within libraries are counted."""
TOLERANCE = 0.05
"""Share by which a count may differ from its record."""


@dataclass(frozen=True)
class CallRecord:
    """Content of `calls.json`."""

    libraries: Mapping[str, str]
    """Versions with which the calls were counted."""
    calls: Mapping[str, Mapping[str, int]]
    """Number of calls by run and room. A call of a library counts for the room whose code makes it."""
    least: Mapping[str, int] = field(default_factory=dict[str, int])
    """Smallest number of calls of each run since the changelog has said why it grew."""

    def limit_from(self, name: str) -> int:
        """Return the number of calls from which the growth of a run is counted; 0 for an unknown run."""
        return self.least.get(name, sum(self.calls.get(name, {}).values()))

    @classmethod
    def read(cls) -> CallRecord:
        """Return the record of the file, an empty one when there is no file."""
        return cls(**json.loads(RECORD.read_text(encoding="utf-8"))) if RECORD.exists() else cls({}, {})

    def write(self) -> None:
        RECORD.write_text(json.dumps(asdict(self), indent=2) + "\n", encoding="utf-8")


class CallCounter:
    """Counter of the calls on this thread between `start` and `stop`; one that is off costs no time."""

    def __init__(self, *, on: bool = True) -> None:
        self._profile = cProfile.Profile()
        self._on = on

    def start(self) -> None:
        gc.collect()
        gc.disable()
        if self._on:
            self._profile.enable()

    def stop(self) -> None:
        self._profile.disable()
        gc.enable()

    def by_room(self) -> dict[str, int]:
        """Return the number of calls by room, sorted by name."""
        found: Counter[str] = Counter()
        for caller in self._profile.getstats():
            for called in caller.calls or ():
                room = room_of(called.code) or room_of(caller.code) or OF_LIBRARIES
                found[room] += called.callcount
        return dict(sorted(found.items()))


def room_of(code: CodeType | str) -> str:
    """Return the room of picktree in which a function is, empty for that of a library or one in C."""
    if isinstance(code, str):
        return ""
    file = Path(code.co_filename)
    if not file.is_relative_to(ROOT) or "site-packages" in file.parts or file.is_relative_to(ROOT / "tests"):
        return ""
    return file.relative_to(ROOT).parts[0]


def golden_run(golden: str, out: Path, counter: CallCounter) -> None:
    """Execute a golden run. The counter is on from its first tick to its result."""
    from picktree.session.observer import Observer
    from picktree.session.session import Session
    from tests.golden.runs import GOLDEN

    class Counting(Observer):
        def started(self, run: object, folder: Path) -> None:
            counter.start()

        def finished(self, result: object) -> None:
            counter.stop()

    Session(GOLDEN[golden].request(out), observers=[Counting()]).run()


def command(counter: CallCounter, *words: str) -> None:
    """Execute a command line."""
    from picktree.cli.app import answer

    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        counter.start()
        answer(words)
        counter.stop()


def counted(folder: Path) -> dict[str, dict[str, int]]:
    """Count the calls of each run and command in this process; logs go into the folder."""
    jam = folder / "jam"
    works: dict[str, Callable[[CallCounter], None]] = {
        "pick": lambda counter: golden_run("pick", folder, counter),
        "kinematic": lambda counter: golden_run("kinematic", folder, counter),
        "check": lambda counter: command(counter, "check", str(ROOT / "examples" / "sort_tirelessly.yaml")),
        "explain": lambda counter: command(counter, "explain", str(next(jam.iterdir()))),
    }
    golden_run("jam", jam, CallCounter(on=False))
    found: dict[str, dict[str, int]] = {}
    for name, work in works.items():
        work(CallCounter(on=False))
        counter = CallCounter()
        work(counter)
        found[name] = counter.by_room()
    return found


@contextmanager
def standing_clock() -> Generator[None]:
    """Let the clock stand still by which logs are brought to disk. Enter it before picktree is imported."""
    running, now = time.monotonic, time.monotonic()
    time.monotonic = lambda: now
    try:
        yield
    finally:
        time.monotonic = running


def in_fresh_process() -> dict[str, dict[str, int]]:
    """Count the calls in another process, in which nothing was imported before."""
    environment = {**os.environ, "PYTHONHASHSEED": "0"}
    done = subprocess.run(
        [sys.executable, __file__], capture_output=True, text=True, check=True, env=environment, cwd=ROOT
    )
    found: dict[str, dict[str, int]] = json.loads(done.stdout.splitlines()[-1])
    return found


def changes(recorded: Mapping[str, Mapping[str, int]], here: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return a sentence for each run whose number of calls is beyond the tolerance, the rooms with it."""
    return [
        sentence
        for name in dict.fromkeys((*recorded, *here))
        if (sentence := _change(name, recorded.get(name, {}), here.get(name, {})))
    ]


def _change(name: str, recorded: Mapping[str, int], here: Mapping[str, int]) -> str:
    before, now = sum(recorded.values()), sum(here.values())
    if not before or not now:
        return f"{name} is {'recorded' if before else 'counted'} only"
    if abs(now - before) <= TOLERANCE * before:
        return ""
    grown = {room: here.get(room, 0) - recorded.get(room, 0) for room in {*recorded, *here}}
    rooms = sorted((room for room in grown if grown[room]), key=lambda room: -abs(grown[room]))[:4]
    where = ", ".join(f"{room} {grown[room]:+,}" for room in rooms)
    return f"{name}: {now:,} calls instead of {before:,}, {now / before - 1.0:+.1%} ({where})"


def unreleased(changelog: str) -> list[str]:
    """Return the entries of the section Unreleased, each with the lines that continue it."""
    section = changelog.partition("## [Unreleased]")[2].partition("\n## ")[0]
    return [" ".join(entry.split()) for entry in re.split(r"\n *- ", section)[1:]]


def updated(
    before: CallRecord,
    calls: Mapping[str, Mapping[str, int]],
    versions: Mapping[str, str],
    changelog: str,
) -> CallRecord:
    """Return the record of new counts. Raises ValueError for growth of which the changelog says nothing."""
    entries = unreleased(changelog)
    least: dict[str, int] = {}
    refused: list[str] = []
    for name, rooms in calls.items():
        now, known = sum(rooms.values()), before.limit_from(name)
        grown = known and now > (1 + TOLERANCE) * known
        if grown and not any(f"`{name}`" in entry and f"{now:,} calls" in entry for entry in entries):
            refused.append(
                f"`{name}` makes {now:,} calls, {now / known - 1.0:+.1%} from {known:,}: "
                f"CHANGELOG.md, Unreleased, needs a line with `{name}` and {now:,} calls that says why"
            )
        least[name] = now if grown or not known else min(now, known)
    if refused:
        raise ValueError("\n".join(refused))
    return CallRecord(versions, calls, least)


def record() -> None:
    """Record the counts, and print what has changed beyond the tolerance.

    Ends the program when a count has grown and the changelog does not say why.
    """
    from tests.golden.runs import libraries

    before = CallRecord.read()
    try:
        text = CHANGELOG.read_text(encoding="utf-8")
        after = updated(before, in_fresh_process(), libraries(), text)
    except ValueError as error:
        sys.exit(f"{error}\nNothing was recorded.")
    after.write()
    changed = changes(before.calls, after.calls)
    print(*changed, sep="\n", end="\n" if changed else "")
    print(f"{len(changed)} of {len(after.calls)} counts have changed by more than {TOLERANCE:.0%}")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help="record the counts")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    if given.write:
        record()
        return 0
    with standing_clock():
        from picktree.arithmetic import restart

        restart()
        with TemporaryDirectory(prefix="calls-") as folder:
            print(json.dumps(counted(Path(folder))))
    return 0


if __name__ == "__main__":
    sys.exit(main())

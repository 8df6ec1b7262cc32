"""A campaign of mistakes in XML: mutated missions through `convert`, and what it passes out and in again.

Counted against us: an exception other than a list of faults, a fault without code or line, a file that takes
more than a second of CPU, and a mission that the way out to XML and in again changes.

python benchmarks/converting.py --runs 10000
"""

from __future__ import annotations

import random
import re
import sys
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from _campaign import ROOT, Row, campaign, finished, options
from _file_mutants import mutant, told, told_all
from picktree.authoring.xml.conversion import convert_text
from picktree.files import FileError
from picktree.trees.loading import NodeRegistry

CHUNK = 250
"""Mutants of one job."""
LIMIT = 1.0
"""CPU seconds that one file may take, all three ways."""
FOLDER = ROOT / "examples"
"""Folder of the mutated missions, from which their plug-ins are looked up."""
WORDS = (
    "Sequence", "Fallback", "Switch2", "Switch99", "Recover", "RecoveryNode", "Guarded", "Precondition",
    "Script", "SubTree", "RepeatWhile", "LoopInt", "CheckExpression", "ForceFailure", "BehaviorTree",
    "TreeNodesModel", "Metadata", "include", "root", "_skipIf", "_while", "_onHalted", "_autoremap",
    "_left_out", "_name", "_no_case", "name", "ID", "path", "code", "case_1", "when", "otherwise", "in", "do",
    "{", "}", "{=}", "{@a}", "{a.b}", "json:", "json:[", "=", "1=1", "grasp.*=1", "&lt;", "&#10;", "&#13;",
    "&#0;", "&a;", "0", "-1", "1e9", "1e400", "true", "a&amp;&amp;b", "!a", "a := 1", "x;y", "'", "''", "/",
    "#", "../x", "library/recovery", "Main", "ü", "\u2028", "\x85", "<!-- c -->", "<![CDATA[a]]>", "<?a b?>",
    "null", "",
)  # fmt: skip
_VALUE = re.compile(r'"[^"]*"')
_NAME = re.compile(r"(?<= )\w+(?==\")")
_TAG = re.compile(r"(?<=<)\w+")


@dataclass(frozen=True)
class Job:
    seed: int


@cache
def corpus() -> tuple[str, ...]:
    """All examples and the library, as XML."""
    registry = NodeRegistry()
    missions = (
        (file, file.read_text(encoding="utf-8"))
        for folder in (FOLDER, ROOT / "trees" / "library")
        for file in sorted(folder.glob("*.yaml"))
    )
    return tuple(convert_text(text, file, registry) for file, text in missions if "kind: mission" in text)


def one(job: Job, folder: Path) -> Row:
    rng = random.Random(job.seed)
    counts: Counter[str] = Counter()
    worst, problems = 0.0, list[str]()
    registry = NodeRegistry()
    corpus()
    for number in range(CHUNK):
        text = _mutant(rng)
        began = time.process_time()
        outcome, problem = _outcome(text, registry)
        seconds = time.process_time() - began
        counts[outcome] += 1
        worst = max(worst, seconds)
        if seconds > LIMIT:
            problem = problem or f"{seconds:.2f} s"
        if problem:
            kept = folder / f"{number}.xml"
            kept.write_text(text, encoding="utf-8", errors="surrogatepass")
            problems.append(f"{kept}: {problem}")
    return {"counts": counts, "worst": worst, "problems": problems}


def _mutant(rng: random.Random) -> str:
    text = rng.choice(corpus())
    if rng.random() < 0.2:
        return mutant(text, corpus(), rng).decode("utf-8", "replace")
    for _ in range(rng.choice((1, 1, 2, 4))):
        text = _mistake(text, rng)
    return text


def _mistake(text: str, rng: random.Random) -> str:
    word = rng.choice(WORDS)
    match rng.randrange(6):
        case 0 | 1:
            return _replaced(text, list(_VALUE.finditer(text)), f'"{word}"', rng)
        case 2:
            return _replaced(text, list(_NAME.finditer(text)), word, rng)
        case 3:
            tags = list(_TAG.finditer(text))
            if not tags:
                return text
            found = rng.choice(tags)
            changed = text[: found.start()] + word + text[found.end() :]
            return changed.replace(f"</{found[0]}>", f"</{word}>", 1) if rng.random() < 0.7 else changed
        case 4:
            return _lines(text, rng)
        case _:
            at = rng.randrange(len(text) + 1)
            return text[:at] + word + text[at + rng.randrange(4) :]


def _replaced(text: str, places: Sequence[re.Match[str]], new: str, rng: random.Random) -> str:
    if not places:
        return text
    found = rng.choice(places)
    return text[: found.start()] + new + text[found.end() :]


def _lines(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(3):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, lines[other])
        case _:
            lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines)


def _outcome(text: str, registry: NodeRegistry) -> tuple[str, str]:
    """Return the outcome of one file, and the fault in that outcome; empty: none."""
    try:
        mission = convert_text(text, FOLDER / "mutant.xml", registry)
    except FileError as error:
        return "refused", _wrong_fault(error)
    except Exception:  # noqa: BLE001 - what the campaign looks for
        return "exception", traceback.format_exc(limit=-4)
    try:
        out = convert_text(mission, FOLDER / "mutant.yaml", registry)
    except FileError as error:
        said = all(fault.code.startswith("P92") for fault in error.faults)
        return "has no XML", "" if said else f"read, and then not a mission: {error}"
    except Exception:  # noqa: BLE001 - what the campaign looks for
        return "exception", "on the way out: " + traceback.format_exc(limit=-4)
    try:
        again = convert_text(out, FOLDER / "mutant.xml", registry)
        same = convert_text(again, FOLDER / "mutant.yaml", registry) == out
    except Exception:  # noqa: BLE001 - what the campaign looks for
        return "passed", "on the way in again: " + traceback.format_exc(limit=-4)
    return "passed", "" if same else "another mission after out and in"


def _wrong_fault(error: FileError) -> str:
    without = [str(fault) for fault in error.faults if not fault.code or fault.mark.line < 1]
    return f"no code or no line: {without}" if without or not error.faults else ""


def main() -> int:
    given = options(__file__, __doc__, runs=10_000, what="files").parse_args()
    jobs = [Job(given.first + n) for n in range(-(-given.runs // CHUNK))]
    rows = finished(campaign(given, jobs, one, cost=CHUNK * 0.02, short=told))
    print(told_all(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())

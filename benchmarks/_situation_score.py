"""Score of an explanation against the label of its situation, by the table of answers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeAlias

import yaml

TABLE = Path(__file__).with_name("situation_answers.yaml")
TIME_TOLERANCE = 1.0
"""Greatest difference of a stated time from the strike, s."""
MAGNITUDE_TOLERANCE = 0.3
"""Greatest difference of a stated magnitude, as a share of the deviation's."""
SILENT = "nothing else in the log shows"
"""Reason of a root cause that only repeats the words of a failure."""
_UNITS = {
    "kg": {"kg": 1.0, "g": 1e-3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "N": {"N": 1.0},
}
"""Factors of the units in which a magnitude may be stated, by the unit of the table."""

Row: TypeAlias = Mapping[str, Any]
Verdict: TypeAlias = Literal[
    "right", "partly", "untold", "wrong", "silent", "blamed", "undecided", "unexplained", "crash"
]
SCORED: tuple[Verdict, ...] = ("right", "partly", "untold", "wrong")
"""Verdicts on situations whose cause is known."""


@cache
def answers() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of answers by kind of deviation."""
    table = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return {kind: row for part in table.values() for kind, row in part.items()}


def verdict_of(row: Row, account: Row) -> Verdict:
    """Return the verdict on the account of a situation's row.

    `right` … `wrong`: the situation has a labelled cause. `silent` and `blamed`: nothing went wrong, or the
    deviations are excluded as causes. `unexplained`: the cell itself fails, and no experiment tells why.
    """
    label = row["label"]
    causes: list[Row] = account["causes"]
    if label["status"] in ("clean", "harmless"):
        blamed = any(each["ended_run"] for each in causes) or (causes and not account["failures"])
        return "blamed" if blamed else "silent"
    stated = judged(row, account)
    if label["status"] == "undecided":
        return "undecided"
    if label["status"] == "no cause":
        excluded = stated is not None and any(
            match(row, number, stated, strict=False) == 2 for number in label["excluded"]
        )
        return "blamed" if excluded else "unexplained"
    if (
        stated is None
        or stated["confidence"].endswith("does not tell")
        or any(SILENT in r for r in stated["reasons"])
    ):
        return "untold"
    groups: list[list[int]] = label["groups"]
    first = [max(match(row, number, stated) for number in group) for group in groups]
    every = [max(match(row, number, each) for number in group for each in causes) for group in groups]
    if first[0] == 2 and all(level == 2 for level in every):
        return "right"
    return "partly" if max(first) else "wrong"


def judged(row: Row, account: Row) -> Row | None:
    """Return the root cause that counts: the first of a missed goal, else that of the costliest failure."""
    causes: list[Row] = account["causes"]
    if row["label"]["target"] == "goal":
        return next((each for each in causes if each["ended_run"]), None)
    wanted = row["label"]["target"]
    numbers = {n for n, fact in enumerate(account["facts"]) if fact == wanted}
    found = [each for each in causes if numbers & set(each["failures"])]
    return found[0] if found else None


def match(row: Row, number: int, cause: Row, *, strict: bool = True) -> int:
    """Return 2 when a root cause names the deviation of that number, 1 when it does in part, else 0.

    strict: names, time and magnitude count, too.
    """
    deviation, strike = row["deviations"][number], row["strikes"].get(str(number), {})
    answer = answers()[deviation["kind"]]
    code = str(cause["cause"])
    if any(fnmatchcase(code, pattern) for pattern in answer["causes"]):
        return 2 if not strict or all(_demands(deviation, strike, answer, cause)) else 1
    return int(any(fnmatchcase(code, pattern) for pattern in answer.get("near", ())))


def _demands(deviation: Row, strike: Row, answer: Row, cause: Row) -> Iterator[bool]:
    """Yield whether a root cause has the names, the time and the magnitude that the table asks for."""
    title = f"{cause['title']} {cause['item']}"
    text = " ".join((title, *cause["reasons"]))
    for name in answer.get("names", ()):
        yield any(_names(title, part, deviation, strike) for part in str(name).split("|"))
    if "time" in answer and "at" in strike:
        yield _time_fits(cause, float(strike["at"]), answer["time"])
    if "magnitude" in answer and deviation["magnitude"] is not None:
        yield _magnitude_fits(text, float(deviation["magnitude"]), str(answer["magnitude"]))


def _names(title: str, name: str, deviation: Row, strike: Row) -> bool:
    words: Sequence[str] = strike.get("words", ()) if name == "item" else ()
    known = deviation["names"].get(name, "")
    if not words and not known:
        return name in ("item", "body", "bin", "node", "camera", "joint")  # nothing is known to be named
    if known and re.search(known, title, re.IGNORECASE):
        return True
    loose = title.replace("_", " ")
    return any(
        word in title or all(part in loose for part in word.split())
        for word in (*words, *([known] if name == "item" and known else []))
    )


def _time_fits(cause: Row, strike: float, manner: str) -> bool:
    stated = [float(cause["time"])] if cause["time"] is not None else []
    spans = [
        (float(a), float(b)) for a, b in re.findall(r"between (\d+\.\d+) and (\d+\.\d+) s", cause["title"])
    ]
    single = [float(each) for each in re.findall(r"(\d+\.\d+) s\b", cause["title"])]
    if manner == "since":
        begins = [*stated, *(b for _, b in spans), *single]
        return not begins or min(begins) >= strike - TIME_TOLERANCE
    near = any(abs(time - strike) <= TIME_TOLERANCE for time in (*stated, *single))
    return near or any(a - TIME_TOLERANCE <= strike <= b + TIME_TOLERANCE for a, b in spans)


def _magnitude_fits(text: str, magnitude: float, unit: str) -> bool:
    for unit_word, factor in _UNITS[unit].items():
        for number in re.findall(rf"(\d+(?:\.\d+)?) {unit_word}\b", text):
            if math.isclose(float(number) * factor, magnitude, rel_tol=MAGNITUDE_TOLERANCE):
                return True
    return False

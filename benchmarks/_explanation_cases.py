"""Cases of the benchmark of explanations: their table, their files, and the verdict on an explanation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias

import yaml

TABLE = Path(__file__).with_suffix("").with_name("explanations.yaml")
HEAD = "picktree: 1\nkind: scene\nbase: sort_small\n"
STRUCK = "<item>"
"""Stands in `names` for the item that a fault struck."""
NONE = "none"
SILENT = "nothing else in the log shows"
"""Reason of a finding that only repeats the words of a failure."""

Verdict: TypeAlias = Literal["right", "partly", "wrong", "does not tell", "nothing happened"]
SCORED: tuple[Verdict, ...] = ("right", "partly", "wrong", "does not tell")


@dataclass(frozen=True)
class Cause:
    """One cause that a right explanation names."""

    causes: tuple[str, ...]
    """Codes of root causes that name it, as patterns."""
    near: tuple[str, ...] = ()
    """Codes that name it in part."""
    names: tuple[str, ...] = ()
    """Words of which title or item hold one each; alternatives are parted by `|`."""

    def match(self, named: Mapping[str, Any], struck: Sequence[Mapping[str, str]]) -> int:
        """Return 2 when a root cause names this one, 1 when it does in part, else 0."""
        text = f"{named['title']} {named['item']}"
        if any(fnmatchcase(named["cause"], pattern) for pattern in self.causes):
            return 2 if all(_says(text, name, struck) for name in self.names) else 1
        return int(any(fnmatchcase(named["cause"], pattern) for pattern in self.near))


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    name: str
    seeds: int
    """First seed."""
    expect: tuple[Cause, ...]
    why: str
    mission: str
    scene: str
    faults: tuple[Mapping[str, Any], ...] = ()
    plugin: str = ""
    backend: str = "kinematic"
    limit: float = 150.0
    """Limit of the run, simulated s."""
    either: bool = False
    """Whether any of the expected causes may stand first."""
    ends: str = ""
    """`killed` from outside, `kills_itself`, `goes_on` while it is explained; empty: the run ends orderly."""
    at: float = 0.0
    """Simulated s at which it is killed, or explained, at the earliest."""
    corrected: Mapping[int, str] | None = None
    """Reason why the expectation is false, by seed."""

    @property
    def inputs(self) -> tuple[object, ...]:
        """Inputs that a run depends on."""
        files = (self.mission, self.scene, self.faults, self.plugin)
        return *files, self.backend, self.limit, self.ends, self.at

    def write(self, folder: Path) -> None:
        """Write the files that its runs need."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.yaml").write_text(HEAD + self.scene)
        (folder / "mission.yaml").write_text(self.mission)
        if self.faults:
            told = {"picktree": 1, "kind": "faults", "faults": [dict(each) for each in self.faults]}
            (folder / "faults.yaml").write_text(yaml.safe_dump(told, sort_keys=False))
        for name in re.findall(r"^plugins: \[(\w+\.py)\]", self.mission, re.MULTILINE):
            (folder / name).write_text(self.plugin)

    def judge(self, told: Mapping[str, Any]) -> Verdict:
        """Return the verdict on an explanation, by the cause that it names first.

        told: as `explanations.explained` returns it.
        """
        named: list[Mapping[str, Any]] = told["causes"]
        if NONE in self.expect[0].causes and not any(each["ended_run"] for each in named):
            return "right" if told["status"] == "success" or not named else "does not tell"
        if told["status"] == "success" and not told["failures"]:
            # There was nothing to explain: what was to go wrong did not.
            return "wrong" if any(each["ended_run"] for each in named) else "nothing happened"
        if not named or str(named[0]["confidence"]).endswith("does not tell"):
            return "does not tell"
        levels = [[each.match(one, told["struck"]) for one in named] for each in self.expect]
        first = [level[0] for level in levels]
        if (max(first) if self.either else first[0]) == 2 and all(map(max, levels)):
            return "right"
        if max(first):
            return "partly"
        return "does not tell" if any(SILENT in reason for reason in named[0]["reasons"]) else "wrong"


def _says(text: str, name: str, struck: Sequence[Mapping[str, str]]) -> bool:
    if name == STRUCK:
        return any(each["id"] in text or each["kind"] in text for each in struck)
    return re.search(name, text, re.IGNORECASE) is not None


def load(path: Path = TABLE) -> list[Case]:
    """Return the cases of a table. Raises ValueError for names or seeds that occur twice."""
    table = yaml.safe_load(path.read_text())
    cases = [_case(name, row, table) for name, row in table["cases"].items()]
    firsts = sorted(case.seeds for case in cases)
    close = [a for a, b in pairwise(firsts) if b - a < 10]
    if close:
        raise ValueError(f"{path}: seeds of two cases are less than 10 apart: {close[0]}")
    return cases


def _case(name: str, row: Mapping[str, Any], table: Mapping[str, Any]) -> Case:
    mission, scene = row.get("mission", "sort"), row.get("scene", "three")
    mission = table["missions"].get(mission, mission)
    if "change" in row:
        old, new = row["change"]
        if old not in mission:
            raise ValueError(f"{name}: the mission does not hold {old!r}")
        mission = mission.replace(old, new)
    rest = {key: row[key] for key in ("plugin", "backend", "limit", "either", "ends", "at") if key in row}
    expect = tuple(
        Cause(tuple(each["causes"]), tuple(each.get("near", ())), tuple(each.get("names", ())))
        for each in row["expect"]
    )
    return Case(
        name,
        row["seeds"],
        expect,
        row["why"],
        mission,
        table["scenes"].get(scene, scene),
        tuple(row.get("faults", ())),
        corrected=row.get("corrected", {}),
        **rest,
    )


def counted(verdicts: Iterable[Verdict]) -> dict[Verdict, int]:
    """Return how often each scored verdict occurs."""
    every = list(verdicts)
    return {verdict: every.count(verdict) for verdict in SCORED}

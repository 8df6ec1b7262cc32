"""Two recipes on the same seeds: which is better, how sure that is, and which seeds changed sides."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..world.errors import PicktreeError
from ..world.files.nearest import nearest
from .statistics import Difference, Paired, Rate, difference, paired, rate
from .store import NAME, Store

SIGNIFICANT = 0.05


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one job came to, as far as it is compared."""

    seed: int
    success: bool
    sorted: int
    sim_seconds: float | None
    held: int
    folder: str
    """Absolute; empty when the log was not kept."""

    @property
    def seconds_a_pick(self) -> float | None:
        return self.sim_seconds / self.held if self.sim_seconds is not None and self.held else None


@dataclass(frozen=True, slots=True)
class Changed:
    """A seed on which one recipe succeeded and the other did not."""

    seed: int
    winner: str
    """A or B."""
    logs: tuple[str, str] | None
    """Of A and B, where both were kept."""


@dataclass(frozen=True, slots=True)
class Comparison:
    label_a: str
    label_b: str
    success_a: Rate
    success_b: Rate
    paired: Paired
    seconds_a_pick: Difference
    """B − A, simulated s."""
    items: Difference
    """B − A, items sorted."""
    changed: tuple[Changed, ...]
    alone: int
    """Seeds that only one of them has."""

    @property
    def differ(self) -> bool:
        """Whether goals are reached more often by one of them than chance explains, or picks take longer."""
        return self.paired.p_value < SIGNIFICANT or self.seconds_a_pick.clear

    def to_json(self) -> dict[str, Any]:
        return {
            "a": self.label_a,
            "b": self.label_b,
            "pairs": self.paired.total,
            "both": self.paired.both,
            "only_a": self.paired.only_a,
            "only_b": self.paired.only_b,
            "neither": self.paired.neither,
            "p_value": self.paired.p_value,
            "seconds_a_pick": _difference_json(self.seconds_a_pick),
            "items": _difference_json(self.items),
            "differ": self.differ,
            "changed": [{"seed": c.seed, "winner": c.winner, "logs": c.logs} for c in self.changed],
            "alone": self.alone,
        }

    def to_json_text(self) -> str:
        return json.dumps(self.to_json(), ensure_ascii=False, indent=2, allow_nan=False) + "\n"

    def to_text(self, program: str = "picktree") -> str:
        p = self.paired
        lines = [
            f"A  {self.label_a}: goal reached {self.success_a}",
            f"B  {self.label_b}: goal reached {self.success_b}",
            f"{p.total} seeds in both" + (f"; {self.alone} in one alone are left out" if self.alone else ""),
            f"goal        both {p.both}, only A {p.only_a}, only B {p.only_b}, neither {p.neither}; "
            f"McNemar p = {p.p_value:.3g}",
            f"s a pick    {_words(self.seconds_a_pick, 'B takes', 's')}",
            f"items       {_words(self.items, 'B sorts', 'a job')}",
        ]
        if p.p_value < SIGNIFICANT:
            lines.append(f"so          {'A' if p.only_a > p.only_b else 'B'} reaches the goal more often")
        elif self.seconds_a_pick.clear:
            lines.append(f"so          {'A' if self.seconds_a_pick.mean > 0 else 'B'} is the faster one")
        else:
            lines.append("so          no difference that these seeds could show")
        for changed in self.changed:
            lines.append(f"  seed {changed.seed}: {changed.winner} alone reached its goal")
            if changed.logs:
                lines.append(f"    {program} diff {changed.logs[0]} {changed.logs[1]}")
        return "\n".join(lines)


def compare(a: str, b: str) -> Comparison:
    """`a` and `b` are batches' folders, or FOLDER@LABEL for one recipe of several.

    Raises PicktreeError when there is none, or they share no seed.
    """
    label_a, outcomes_a = _recipe(a)
    label_b, outcomes_b = _recipe(b)
    shared = sorted(set(outcomes_a) & set(outcomes_b))
    if not shared:
        raise PicktreeError(f"{a} and {b} share no seed that was run: nothing can be paired")
    pairs = [(outcomes_a[seed], outcomes_b[seed]) for seed in shared]
    times = [
        (x.seconds_a_pick, y.seconds_a_pick)
        for x, y in pairs
        if x.seconds_a_pick is not None and y.seconds_a_pick is not None
    ]
    return Comparison(
        label_a,
        label_b,
        rate(sum(x.success for x, _ in pairs), len(pairs)),
        rate(sum(y.success for _, y in pairs), len(pairs)),
        paired([(x.success, y.success) for x, y in pairs]),
        difference(times),
        difference([(float(x.sorted), float(y.sorted)) for x, y in pairs]),
        tuple(
            Changed(
                x.seed,
                "A" if x.success else "B",
                (x.folder, y.folder) if x.folder and y.folder else None,
            )
            for x, y in pairs
            if x.success != y.success
        ),
        len(set(outcomes_a) ^ set(outcomes_b)),
    )


def _recipe(where: str) -> tuple[str, dict[int, Outcome]]:
    """One recipe's label and its outcomes by seed."""
    folder_name, _, wanted = where.partition("@")
    folder = Path(folder_name)
    with Store(folder / NAME) as store:
        labels = [
            str(row[0]) for row in store.query("SELECT DISTINCT variant FROM jobs ORDER BY number").rows
        ]
        fitting = [label for label in labels if wanted in label]
        exact = [label for label in labels if label == wanted]
        if len(exact or fitting) != 1:
            hint = nearest(wanted, labels) if wanted and not fitting else "one of " + "; ".join(labels)
            raise PicktreeError(f"{where}: name one recipe as {folder_name}@LABEL ({hint})")
        (label,) = exact or fitting
        found = store.query(
            "SELECT variant, seed, status, items_sorted, sim_seconds, picks_held, folder FROM jobs "
            "WHERE status <> 'waiting'"
        )
    outcomes: dict[int, Outcome] = {}
    rows: Any = found.rows
    for variant, seed, status, items, seconds, held, kept in rows:
        if variant == label:
            path = str((folder / kept).absolute()) if kept else ""
            outcomes[seed] = Outcome(seed, status == "success", items or 0, seconds, held or 0, path)
    name = folder.name if len(labels) == 1 else f"{folder.name}@{label}"
    return name, outcomes


def _words(found: Difference, verb: str, unit: str) -> str:
    if not found.pairs:
        return "nothing to compare"
    more = "more" if found.mean >= 0 else "less"
    interval = found.interval
    if math.isinf(interval.low):
        return f"{verb} {abs(found.mean):.2f} {unit} {more}; one pair tells no interval"
    return (
        f"{verb} {abs(found.mean):.2f} {unit} {more} "
        f"(B − A: {interval.low:+.2f} … {interval.high:+.2f}, 95 %, {found.pairs} pairs)"
    )


def _difference_json(found: Difference) -> dict[str, Any]:
    finite = not math.isinf(found.interval.low)
    return {
        "mean": found.mean,
        "low": found.interval.low if finite else None,
        "high": found.interval.high if finite else None,
        "pairs": found.pairs,
    }

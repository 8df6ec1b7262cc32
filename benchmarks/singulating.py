"""Campaign: sort items that touch each other, with pushes and without, over many seeds.

    python benchmarks/singulating.py --runs 50

Seed by seed the same scene is sorted twice: by `examples/sort_by_colour.yaml`, and by the same mission
with the pushes taken out.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, cast

from _campaign import ROOT, Row, campaign, finished, options, rate, seeds

COST_A_RUN = 20.0
"""CPU seconds of one seed, both ways, for the forecast."""
MISSION = ROOT / "examples" / "sort_by_colour.yaml"
WAYS = ("with", "without")


@dataclass(frozen=True)
class Job:
    seed: int
    scene: str


def one(job: Job, folder: Path) -> Row:
    """One seed in this process, with pushes and without."""
    from picktree.session import RunRequest, Session

    row: Row = {}
    for name in WAYS:
        mission = MISSION if name == "with" else without_pushes(folder / "without_pushes.yaml")
        request = RunRequest(mission=mission, scene=job.scene, seed=job.seed, out=folder / name)
        try:
            row[name] = Session(request).run().to_json()
        except Exception as error:  # noqa: BLE001  a crash is a figure of the campaign
            row[name] = {"crash": f"{type(error).__name__}: {error}"}
    return row


def without_pushes(path: Path) -> Path:
    """The mission with each branch that pushes taken out, written to `path`."""
    import yaml

    data = cast("dict[str, Any]", yaml.safe_load(MISSION.read_text()))
    data["trees"] = _pruned(data["trees"])
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


def _pruned(value: Any) -> Any:
    """Remove pushes, and fallbacks that begin with a push, from all lists of children."""
    if isinstance(value, dict):
        return {key: _pruned(child) for key, child in cast("dict[str, Any]", value).items()}
    if isinstance(value, list):
        return [_pruned(child) for child in cast("list[Any]", value) if not _pushes(child)]
    return value


def _pushes(child: Any) -> bool:
    if not isinstance(child, dict):
        return False
    node = cast("dict[str, Any]", child)
    first = node.get("Fallback")
    return "Push" in node or (isinstance(first, list) and bool(first) and _pushes(first[0]))


def report(rows: Sequence[Row]) -> str:
    lines: list[str] = []
    for name in WAYS:
        done = [row[name] for row in rows if "items" in row[name]]
        lines.append(f"{name} pushes: {len(rows)} runs, {len(rows) - len(done)} crashed")
        if not done:
            continue
        total = sum(r["items"]["total"] for r in done)
        lines.append("  " + rate("items sorted", sum(r["items"]["sorted"] for r in done), total))
        whole = sum(r["items"]["sorted"] == r["items"]["total"] for r in done)
        lines.append("  " + rate("scenes sorted whole", whole, len(rows)))
        lines.append(
            f"  medians a scene: {median(r['sim_seconds'] for r in done):.0f} s simulated, "
            f"{median(r['cpu_seconds'] for r in done):.1f} s CPU"
        )
        causes: Counter[str] = Counter()
        for r in done:
            causes.update(r["failures"])
        told = ", ".join(f"{cause} {count}" for cause, count in causes.most_common())
        lines.append(f"  failures by cause: {told or 'none'}")
        for row in rows:
            items = row[name].get("items")
            if items is None:
                lines.append(f"    seed {row['seed']}: {row[name]['crash']}")
            elif items["sorted"] < items["total"]:
                lines.append(f"    seed {row['seed']}: {items['sorted']} of {items['total']}")
    return "\n".join(lines)


def main() -> int:
    parser = options(__file__, __doc__, runs=50)
    parser.add_argument("--scene", default="touching")
    given = parser.parse_args()
    rows = campaign(
        given,
        [Job(seed, given.scene) for seed in seeds(given)],
        one,
        cost=COST_A_RUN,
        short=lambda row: ", ".join(
            f"{name} {row[name]['items']['sorted']}" if "items" in row[name] else f"{name} crashed"
            for name in WAYS
        ),
    )
    print(report(finished(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())

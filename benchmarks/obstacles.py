"""Campaign: something that the robot is not told of stands in its way, or is put there between two picks.

    python benchmarks/obstacles.py --runs 100

In each run one thing of random size (a post, a round post, a wall, a bar that hangs) stands on the straight
way from an item to its bin: from the beginning (even seeds), or from a random time in the last half second of
a pick on (odd seeds). What touches it is asked of the simulator at every step; it stands fast, so nothing
moves it. Each scene is run again with the volumes left out of the belief, to show that it is in the way.

An item can be reached when it is sorted, or when the same mission sorts it where the robot is told from the
beginning, as a fixture, exactly where the thing stands (without physics, so that nothing else goes wrong).
"""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from _campaign import MissionJob, Row, campaign, mission_jobs, mission_options, rate
from picktree.world.event_types import ItemDoneEvent

import numpy as np

if TYPE_CHECKING:
    from picktree.session import Session
    from picktree.simulation import SpawnedItem
    from picktree.world.scene import Fixture, SceneDescription

COST_A_RUN = 28.0
"""CPU seconds that three or four runs of four items take, for the forecast."""
ITEM_GAP, BIN_GAP = 0.045, 0.012
"""Smallest horizontal distances of an obstacle from items and from bins, m."""
HANGS = 0.12
"""A bar that hangs leaves at least this below it, m."""
COLOURS = ("grey", "dark_grey", "white", "red", "green", "blue", "yellow")


def one(job: MissionJob, folder: Path) -> Row:
    """Run one seed with the thing in the way, without volumes, told of it, and where it comes later without
    it."""
    from picktree.simulation import spawn_items
    from picktree.world.scene import load_scene

    scene = load_scene(job.scene)
    rng = np.random.default_rng([job.seed, 77])
    items = list(spawn_items(scene, job.seed))
    if job.seed % 2 == 0:
        item = items[int(rng.integers(len(items)))]
        entry = _drawn(rng, scene, items, item, job.seed)
        text = json.dumps({"picktree": 1, "kind": "scene", "base": job.scene, "unknown": {"thing": entry}})
        (folder / "scene.yaml").write_text(text)
        with_it: dict[str, Any] = {"scene": str(folder / "scene.yaml")}
        row: Row = {"comes": None}
    else:
        with _watched() as touches:
            free = _run(job, folder / "free", touches, scene=job.scene)
        done = free["done"]
        number = int(rng.integers(len(done) - 1))
        item = next(
            i for i in items if i.colour in done[number + 1][1] and i.entry.kind in done[number + 1][1]
        )
        entry = _drawn(rng, scene, items, item, job.seed)
        at = done[number][0] - float(rng.uniform(0.0, 0.5))
        fault = {"fault": "obstacle", "when": {"at": round(at, 3)}, "body": entry, "name": "thing"}
        (folder / "faults.yaml").write_text(json.dumps({"picktree": 1, "kind": "faults", "faults": [fault]}))
        with_it = {"scene": job.scene, "faults": folder / "faults.yaml"}
        row = {"comes": round(at, 3), "free": free}
    with _watched() as touches:
        row["seen"] = _run(job, folder / "seen", touches, **with_it)
    with _watched() as touches, _without_volumes():
        row["blind"] = _run(job, folder / "blind", touches, **with_it)
    text = json.dumps(
        {"picktree": 1, "kind": "scene", "base": job.scene, "fixtures": {"thing": _as_fixture(entry)}}
    )
    (folder / "told.yaml").write_text(text)
    row["told"] = _run(
        job, folder / "told", lambda _: {}, scene=str(folder / "told.yaml"), backend="kinematic"
    )
    return row | {"thing": entry, "item": f"{item.colour} {item.entry.kind}"}


def _as_fixture(entry: dict[str, Any]) -> dict[str, Any]:
    """The same thing as an entry of which the robot is told: a box, with the same section where it is
    round."""
    told = {key: value for key, value in entry.items() if key in ("box", "at", "yaw")}
    if "cylinder" in entry:
        side = math.sqrt(math.pi) * entry["cylinder"]["radius"]
        told["box"] = [side, side, entry["cylinder"]["height"]]
    return told


def _run(
    job: MissionJob, folder: Path, touches: Callable[[Session], dict[str, Any]], **options: Any
) -> dict[str, Any]:
    from picktree.analysis import Run
    from picktree.session import RunRequest, Session

    request = RunRequest(mission=Path(job.mission), seed=job.seed, out=folder, **options)
    session = Session(request)
    touched = touches(session)
    result = session.run()
    with Run(result.folder) as run:
        done = [(at.time, at.record.object) for at in run.events if isinstance(at.record, ItemDoneEvent)]
    items = result.items
    return {
        "sorted": items.sorted,
        "total": items.total,
        "by_form": {form: count.sorted for form, count in items.by_form.items()},
        "status": result.status,
        "failures": dict(result.failures),
        "seconds": round(result.sim_seconds, 2),
        "cpu": round(result.cpu_seconds, 2),
        "done": done,
        "touched": touched,
        "folder": str(result.folder),
    }


@contextmanager
def _watched() -> Generator[Callable[[Session], dict[str, Any]]]:
    """Who touches what the robot was not told of, with the time of the first touch and the greatest force, N:
    filled in while the session runs, by asking the simulator after each step."""
    from picktree.simulation.physics import PhysicsHardware

    def watch(session: Session) -> dict[str, Any]:
        hardware = session.execution.hardware
        assert isinstance(hardware, PhysicsHardware)
        found: dict[str, Any] = {}
        step = hardware.step

        def stepped() -> None:
            step()
            names = {str(body.id) for body in hardware.obstacles()}
            if not names:
                return
            for contact in hardware.true_contacts():
                if contact.distance > 0.0 and contact.force <= 0.0:
                    continue
                pair = {contact.one, contact.other}
                for other in pair - names if pair & names else ():
                    known = found.setdefault(other, {"at": round(hardware.clock.now, 3), "force": 0.0})
                    known["force"] = round(max(known["force"], contact.force), 2)

        hardware.step = stepped  # pyright: ignore[reportAttributeAccessIssue]
        return found

    yield watch


@contextmanager
def _without_volumes() -> Generator[None]:
    """The belief holds nothing but items meanwhile."""
    from picktree.robot.perception import data_association
    from picktree.world import ObjectId

    kept = data_association.update_volumes

    def nothing(*_: object) -> list[ObjectId]:
        return []

    data_association.update_volumes = nothing
    try:
        yield
    finally:
        data_association.update_volumes = kept


def _drawn(
    rng: np.random.Generator, scene: SceneDescription, items: list[SpawnedItem], item: SpawnedItem, seed: int
) -> dict[str, Any]:
    """Something in the way from the item to its bin, as an entry of a scene file."""
    from picktree.simulation import FreeSpaceCheck, TrueBody, distance, footprint
    from picktree.world.robot_model import RobotModel, load_robot
    from picktree.world.scene.destinations import destination_rule

    body = TrueBody.of(item.id, item.entry, item.colour, item.pose)
    goal = next(b for b in scene.bins if b.id == destination_rule(scene.destinations)(body))
    start, end = np.array(item.pose.position[:2]), np.array(goal.pose.position[:2])
    across = math.atan2(float(end[1] - start[1]), float(end[0] - start[0])) + math.pi / 2
    model = RobotModel(load_robot(scene.robot))
    room = FreeSpaceCheck(model)
    around = [footprint(i.entry.shape, i.pose.orientation).at(i.pose.position[:2]) for i in items]
    bins = [footprint(s, p.orientation).at(p.position[:2]) for b in scene.bins for s, p in b.parts()]
    for _ in range(500):
        at = start + (end - start) * float(rng.uniform(0.2, 0.8)) + rng.uniform(-0.03, 0.03, 2)
        entry, thing = _thing(rng, float(at[0]), float(at[1]), across)
        outline = footprint(thing.shape, thing.pose.orientation).at(thing.pose.position[:2])
        if any(distance(outline, other) < ITEM_GAP for other in around):
            continue
        if any(distance(outline, other) < BIN_GAP for other in bins):
            continue
        if room.free(thing.shape, thing.pose, (), model.named("home"), 0.08):
            return entry
    raise RuntimeError(f"seed {seed}: nothing fits between {item.colour} {item.entry.kind} and {goal.id}")


def _thing(rng: np.random.Generator, x: float, y: float, across: float) -> tuple[dict[str, Any], Fixture]:
    from picktree.world.scene import UnknownFile, hidden_body

    def drawn(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 4)

    colour = COLOURS[int(rng.integers(len(COLOURS)))]
    kind = rng.choice(["post", "post", "round", "wall", "bar"])
    entry: dict[str, Any]
    if kind == "post":
        high = drawn(0.10, 0.40)
        yaw = drawn(-math.pi, math.pi)
        entry = {"box": [drawn(0.04, 0.10), drawn(0.04, 0.10), high], "at": [x, y, high / 2], "yaw": yaw}
    elif kind == "round":
        high = drawn(0.10, 0.40)
        entry = {"cylinder": {"radius": drawn(0.02, 0.05), "height": high}, "at": [x, y, high / 2]}
    else:
        yaw, long, thick = across + drawn(-0.4, 0.4), drawn(0.12, 0.30), drawn(0.03, 0.06)
        high = drawn(0.08, 0.30) if kind == "wall" else drawn(0.03, 0.06)
        middle = high / 2 if kind == "wall" else drawn(HANGS + high / 2, 0.35)
        entry = {"box": [long, thick, high], "at": [x, y, middle], "yaw": yaw}
    entry["colour"] = colour
    return entry, hidden_body("thing", UnknownFile.model_validate(entry))


def _reachable(row: Row) -> int:
    """Number of the items that can be reached; see above."""
    seen, told = row["seen"]["by_form"], row["told"]["by_form"]
    return sum(max(count, told[form]) for form, count in seen.items())


def report(rows: list[Row]) -> str:
    done = [row for row in rows if "seen" in row]
    lines = [f"scenes {len(rows)}, crashed {len(rows) - len(done)}"]
    for name, of in (("the volumes", "seen"), ("no volumes", "blind")):
        runs = [row[of] for row in done]
        touched = sum(bool(run["touched"]) for run in runs)
        lines += [
            f"with {name}",
            rate("  scenes touched", touched, len(runs)),
            rate("    by the robot", sum(any(map(_robot, run["touched"])) for run in runs), len(runs)),
            rate(
                "    by an item",
                sum(any(not _robot(who) for who in run["touched"]) for run in runs),
                len(runs),
            ),
            rate("  of all items sorted", sum(r["sorted"] for r in runs), sum(r["total"] for r in runs)),
            rate("  scenes with all sorted", sum(r["sorted"] == r["total"] for r in runs), len(runs)),
        ]
        if of == "seen":
            reachable = sum(map(_reachable, done))
            lines.append(rate("  of those that can be reached", sum(r["sorted"] for r in runs), reachable))
        causes: Counter[str] = Counter()
        for run in runs:
            causes.update(run["failures"])
        lines.append(
            "  failures by cause: " + (", ".join(f"{c} {n}" for c, n in causes.most_common()) or "none")
        )
    seconds = sum(r["seen"]["seconds"] for r in done) / max(1, sum(r["seen"]["sorted"] for r in done))
    lines.append(f"simulated seconds an item sorted, with the volumes: {seconds:.2f}")
    for row in rows:
        if "crash" in row:
            lines.append(f"  seed {row['seed']}: {row['crash']}")
        elif row["seen"]["touched"] or row["seen"]["sorted"] < row["seen"]["total"]:
            seen = row["seen"]
            lines.append(
                f"  seed {row['seed']}: {seen['sorted']} of {seen['total']} sorted, {_reachable(row)} can be "
                f"reached, touched by "
                f"{seen['touched'] or 'nothing'}; {row['thing']}, comes {row['comes'] or 'at the beginning'}"
            )
    return "\n".join(lines)


def _robot(who: str) -> bool:
    return not who.startswith("item_")


def _short(row: Row) -> str:
    seen, blind = row["seen"], row["blind"]
    return (
        f"{seen['sorted']} of {_reachable(row)} of {seen['total']}, touched {seen['touched'] or 'nothing'}; "
        f"blind {blind['sorted']} of {blind['total']}, touched {list(blind['touched']) or 'nothing'}"
    )


def main() -> int:
    given = mission_options(__file__, __doc__, "sort_past_obstacles", "sort_small", runs=100).parse_args()
    print(report(campaign(given, mission_jobs(given), one, cost=COST_A_RUN, short=_short)))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Campaign: SafeRetreat from random states in physics: is it gentle, does it get home or say why not?

    python benchmarks/retreats.py --runs 1000

States are made by moving there, with an empty hand or with something grasped in it, among items, bins and a
known post: `free` (arrived at a random configuration), `halted` (a fast motion stopped at a random moment),
`collision` (driven into something under guard), `pressed` (the stiff servo told to be some millimetres inside
of what it touches), `believed` (something is believed where the arm is, and is not there), `unknown`
(something stands beside the arm of which nothing is known). Five states share a scene.

The contact force is the simulator's: the sum over the contact points of two bodies, one being the robot or
what it holds, the other neither. `force` is its mean over 37.5 ms, as the safety monitor takes it; `peak` the
worst single step of 1/240 s. What pressed before the retreat began counts only from when it has once gone
down to 5 N, or beyond what it was.
"""

from __future__ import annotations

import importlib.util
import math
import sys
import time
from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from _campaign import ROOT, Row, campaign, finished, options, rate

import numpy as np

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.world import Array, Pose

STATES = 5
"""Number of states in each scene."""
CLASSES = ("free", "halted", "collision", "pressed", "believed", "unknown")
COST = 3.0
"""CPU seconds a state, for the forecast."""
LIMIT = 20.0
"""No contact above this, N."""
SMOOTHING = 0.0375
GONE = 5.0
"""Contact force below which a contact that pressed has gone, N."""
LONGEST = 150.0
"""Simulated seconds after which a retreat counts as hung."""
AT_HOME = 5e-3
"""Largest joint error at the home configuration, rad."""
IN_HAND = 0.09
"""Largest distance of a held item's centre from the tool, m."""


@dataclass(frozen=True)
class Job:
    seed: int
    states: int


@dataclass
class Felt:
    """Contact forces during one retreat, by pairs of bodies."""

    before: dict[tuple[str, str], float] = field(default_factory=dict[tuple[str, str], float])
    mean: dict[tuple[str, str], float] = field(default_factory=dict[tuple[str, str], float])
    force: float = 0.0
    peak: float = 0.0
    where: str = ""


def _cell() -> ModuleType:
    """Load the module with which the tests drive missions."""
    spec = importlib.util.spec_from_file_location("cell", ROOT / "tests" / "skills" / "cell.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["cell"] = module
    spec.loader.exec_module(module)
    return module


def one(job: Job, folder: Path) -> Row:
    """The states of one seed's scene, each with what came of the retreat from it."""
    answers: list[dict[str, Any]] = []
    lab: Lab | None = None
    for k in range(job.states):
        number = job.seed * STATES + k
        begun = time.process_time()
        try:
            if lab is None:
                lab = Lab(number)
            answer = lab.state(number)
            if answer["outcome"] != "home":
                lab = None
        except Exception as error:  # noqa: BLE001  a crash is a figure of the campaign
            answer = {"number": number, "outcome": "crash", "message": f"{type(error).__name__}: {error}"}
            lab = None
        answers.append(answer | {"cpu": round(time.process_time() - begun, 2)})
    return {"states": answers}


class Lab:
    """A cell in physics, with a post that is known; states are made in it one after the other."""

    def __init__(self, number: int) -> None:
        from picktree.world import Box, ObjectId, Pose
        from picktree.world.scene import Fixture, load_scene

        self.cell = _cell()
        rng = np.random.default_rng([number, 80])
        scene = load_scene("sort_small")
        high = float(rng.uniform(0.10, 0.35))
        x, side = float(rng.uniform(0.35, 0.65)), float(rng.choice([-1.0, 1.0]))
        post = Fixture(
            ObjectId("post"),
            Box((0.05, 0.05, high)),
            Pose((x, side * float(rng.uniform(0.25, 0.31)), high / 2)),
        )
        self.scene = replace(scene, fixtures=(*scene.fixtures, post))
        self.run = self.cell.Cell(
            self.cell.mission("Observe: {camera: overhead}"), self.scene, "physics", number
        )
        self.run.finish()
        self.world: World = self.run.world
        self.links = set(self.world.robot.link_poses(self.world.control.state.position, 0.0))

    def state(self, number: int) -> dict[str, Any]:
        """Make the state of that number and retreat from it."""
        rng = np.random.default_rng([number, 81])
        kind = CLASSES[number % len(CLASSES)]
        world = self.world
        if rng.random() < 0.5:
            self._grasp(rng)
        hand = str(rng.choice(["keep", "keep", "keep", "open", "put_down"]))
        item = self._in_hand()
        made = getattr(self, f"_{kind}")(rng)
        if item is not None and self._in_hand() != item:
            item = None  # lost while the state was made
        row: dict[str, Any] = {
            "number": number,
            "class": kind,
            "hand": hand if item else "empty",
            "made": made,
        }
        tcp = world.control.tcp
        row["tcp"] = [round(c, 3) for c in tcp.position]
        row["stopped"] = world.control.monitor.stopped.cause.name if world.control.monitor.stopped else ""
        row |= self._retreat(hand, item)
        self._clean()
        return row

    def _retreat(self, hand: str, item: str | None) -> dict[str, Any]:
        world, hardware = self.world, self.run.hardware
        felt = Felt()
        for pair, force in self._forces(item).items():
            felt.before[pair] = force
        pressed = max(felt.before.values(), default=0.0)
        step, mine = hardware.step, item

        def stepped() -> None:
            step()
            self._note(felt, self._forces(mine), hardware.period)

        hardware.step = stepped
        begun = world.clock.now
        try:
            self.run.start(self.cell.mission(f"SafeRetreat: {{hand: {hand}}}"))
            while True:
                self.run.tick()
                if not self.run.running or world.clock.now - begun > LONGEST:
                    break
        finally:
            hardware.step = step
        failure = self.run.tree.failure
        off = float(np.abs(hardware.arm.read().position - world.robot.named("home")).max())
        home = off < AT_HOME and world.control.monitor.stopped is None
        kept = item is not None and self._in_hand() == item
        cause = failure.cause.name if failure else ""
        outcome = self._outcome(cause, home, kept, item, hand)
        return {
            "outcome": outcome,
            "cause": cause,
            "message": failure.message if failure else "",
            "tried": list(failure.evidence.get("tried") or ()) if failure else [],
            "home": home,
            "kept": kept,
            "seconds": round(world.clock.now - begun, 2),
            "before": round(pressed, 1),
            "force": round(felt.force, 1),
            "peak": round(felt.peak, 1),
            "where": felt.where,
        }

    def _outcome(self, cause: str, home: bool, kept: bool, item: str | None, hand: str) -> str:
        """`home`, `refused` (and says so truly), or what is wrong."""
        if self.run.running:
            return "hung"
        if not cause:
            if not home:
                return "says home, and is not"
            if item and hand == "keep" and not kept:
                return "says kept, and is not"
            return "says let go, and is not" if item and hand != "keep" and kept else "home"
        if self.run.speed > 0.02 or not self.world.control.at_rest:
            return "fails and moves"
        if cause == "grasp.slipped":
            return "lost" if not kept else "says lost, and is not"
        return "refused" if cause in ("safety.no_retreat", "place.occupied") else f"fails with {cause}"

    def _note(self, felt: Felt, forces: dict[tuple[str, str], float], period: float) -> None:
        share = period / (SMOOTHING + period)
        for pair in felt.mean.keys() | forces.keys():
            now = forces.get(pair, 0.0)
            mean = felt.mean.get(pair, 0.0)
            felt.mean[pair] = mean = mean + share * (now - mean)
            before = felt.before.get(pair)
            if before is not None:
                if now < GONE:
                    del felt.before[pair]
                    felt.mean[pair] = mean = now
                elif now <= before + 1.0:
                    felt.mean[pair] = 0.0
                    continue
            felt.peak = max(felt.peak, now)
            if mean > felt.force:
                felt.force, felt.where = mean, " – ".join(pair)

    def _forces(self, item: str | None) -> dict[tuple[str, str], float]:
        """Return the contact forces on the robot and its held item by pair of names, N."""
        contacts = self.run.hardware.true_contacts()
        fingers = set(self.world.robot.finger_links)
        mine = set(self.links)
        if item and any({c.one, c.other} & fingers and item in (c.one, c.other) for c in contacts):
            mine.add(item)
        found: dict[tuple[str, str], float] = {}
        for contact in contacts:
            if (contact.one in mine) == (contact.other in mine):
                continue
            pair = (contact.one, contact.other) if contact.one in mine else (contact.other, contact.one)
            if pair[0] == "panda_link0":
                continue
            found[pair] = found.get(pair, 0.0) + contact.force
        return found

    def _in_hand(self) -> str | None:
        """The item that is really between the fingers: by what touches both pads and hangs at the tool."""
        tool = np.array(self.run.hardware.true_tcp().position)
        fingers = set(self.world.robot.finger_links)
        touched = Counter(
            name
            for c in self.run.hardware.true_contacts()
            for name, by in ((c.one, c.other), (c.other, c.one))
            if by in fingers and name.startswith("item_")
        )
        for body in self.run.hardware.truth():
            near = float(np.linalg.norm(np.array(body.pose.position) - tool)) < IN_HAND
            if near and touched[str(body.id)] and self.world.gripper.width > 0.002:
                by = {
                    f
                    for c in self.run.hardware.true_contacts()
                    for f, n in ((c.one, c.other), (c.other, c.one))
                    if f in fingers and n == str(body.id)
                }
                if len(by) == 2:
                    return str(body.id)
        return None

    # ---- making states

    def _free(self, rng: np.random.Generator) -> str:
        return self._go(rng, 1.0)

    def _halted(self, rng: np.random.Generator) -> str:
        return self._go(rng, float(rng.uniform(0.1, 0.9)))

    def _collision(self, rng: np.random.Generator) -> str:
        """Straight towards something, which is allowed to be touched meanwhile, with a guard of 25 N."""
        self._go(rng, 1.0)
        name, pose = self._target(rng)
        with self.world.scene.allow(("gripper", name), ("arm", name), *self._held_pair(name)):
            said = self._drive(pose, float(rng.uniform(0.1, 0.5)))
        return f"into {name}: {said}"

    def _pressed(self, rng: np.random.Generator) -> str:
        """Down or sideways until it touches, then some millimetres further with the stiff servo."""
        from picktree.robot.control.joint_controllers import TrajectoryController
        from picktree.robot.planning import Scaling, time_corners
        from picktree.world import Failure

        world = self.world
        for _ in range(4):
            self._go(rng, 1.0)
            along = np.array([0.0, 0.0, -1.0])
            if rng.random() < 0.4:
                turn = float(rng.uniform(-math.pi, math.pi))
                along = np.array([math.cos(turn), math.sin(turn), -0.2])
            along /= np.linalg.norm(along)
            try:
                felt = self._finish(world.move.guarded(along, 0.35, force=6.0, speed=0.1))
            except Failure:
                continue
            if felt.contact:
                break
        else:
            return "felt nothing"
        deeper = float(rng.uniform(0.0005, 0.004))
        q = world.control.held_position
        jacobian = world.robot.jacobian(q)
        step = np.linalg.pinv(jacobian) @ np.concatenate([along * deeper, np.zeros(3)])
        timed = time_corners(world.robot, np.array([q, q + step]), Scaling(0.02, 0.02), 0.1)
        assert timed is not None
        lease = world.control.acquire("press")
        lease.run(TrajectoryController(timed, world.robot, world.control.period))
        for _ in range(math.ceil(timed.duration / world.tick) + 4):
            self.run.wait()
        lease.release()
        for _ in range(40):
            self.run.wait()
            if world.control.at_rest:
                break
        return f"{deeper * 1000:.1f} mm into what it touches"

    def _believed(self, rng: np.random.Generator) -> str:
        """Something is believed about a link of the arm, or an item's place is believed to be there."""
        from picktree.world import BeliefObject, Box, ObjectId, Pose

        self._go(rng, 1.0)
        world = self.world
        poses = world.robot.link_poses(world.control.state.position, world.gripper.width)
        link = str(rng.choice([f"panda_link{k}" for k in (4, 5, 6, 7)] + ["panda_hand", "panda_hand"]))
        x, y, z = (float(c) for c in np.array(poses[link].position) + rng.uniform(-0.06, 0.06, 3))
        size = tuple(float(s) for s in rng.uniform(0.04, 0.15, 3))
        box = Box((size[0], size[1], size[2]))
        pose = Pose.from_rpy((x, y, z), (0.0, 0.0, float(rng.uniform(-3, 3))))
        known = ("unknown", "unknown", box, "grey", pose)
        phantom = BeliefObject(
            *known, 0.002, 0.0, 1.0, world.clock.now, id=ObjectId("phantom"), role="obstacle"
        )
        world.scene.put(phantom, "supposed by the campaign")
        deep = [c for c in world.plan.contacts() if c.distance < 0]
        depth = -min((c.distance for c in deep), default=0.0)
        return f"a box about {link}, {len(deep)} pairs, {depth * 1000:.0f} mm deep"

    def _unknown(self, rng: np.random.Generator) -> str:
        """Something stands fast beside the arm, and has not been seen."""
        from picktree.world import Box, ObjectId, Pose
        from picktree.world.scene import Fixture

        self._go(rng, 1.0)
        tcp = np.array(self.world.control.tcp.position)
        for _ in range(60):
            turn, away = float(rng.uniform(-math.pi, math.pi)), float(rng.uniform(0.05, 0.16))
            size = tuple(float(s) for s in rng.uniform(0.03, 0.12, 3))
            x, y = float(tcp[0] + away * math.cos(turn)), float(tcp[1] + away * math.sin(turn))
            z = max(size[2] / 2 + 0.001, float(tcp[2] + rng.uniform(-0.05, 0.15)))
            body = Fixture(ObjectId("thing"), Box((size[0], size[1], size[2])), Pose((x, y, z)))
            if self.run.hardware.room_for(body):
                self.thing = self.run.hardware.put_obstacle(body)
                return f"a box {away * 1000:.0f} mm beside the tool"
        return "no room for anything beside it"

    def _go(self, rng: np.random.Generator, share: float) -> str:
        """Move to a random configuration that is believed to be free, anywhere or low among things.

        The motion is halted after a share of its time."""
        from picktree.robot.planning import JointGoal, Scaling
        from picktree.world import Failure

        world = self.world
        for _ in range(12):
            goal = self._anywhere(rng) if rng.random() < 0.3 else self._low(rng)
            if goal is None:
                continue
            try:
                plan = self._finish(world.plan.to(JointGoal(goal), scaling=Scaling(0.6, 0.6), node="state"))
            except Failure:
                continue
            doing = world.move.along(plan.trajectory, guard=30.0)
            ticks = math.ceil(share * plan.trajectory.duration / world.tick)
            try:
                for _ in range(ticks if share < 1.0 else 10_000):
                    next(doing)
                    self.run.wait()
                doing.close()
            except StopIteration:
                pass
            except Failure as failure:
                return failure.cause.name
            return f"{share * 100:.0f} % of a motion"
        return "no motion"

    def _anywhere(self, rng: np.random.Generator) -> Array:
        model = self.world.robot
        q = model.named("home") + rng.uniform(-0.9, 0.9, model.n)
        return np.clip(q, model.planned_lower, model.planned_upper)

    def _low(self, rng: np.random.Generator) -> Array | None:
        from picktree.world import Pose

        place = rng.random()
        if place < 0.3:
            bins = list(self.scene.bins)
            at = bins[int(rng.integers(len(bins)))].pose.position
            x, y = at[0] + float(rng.uniform(-0.05, 0.05)), at[1] + float(rng.uniform(-0.04, 0.04))
        else:
            x, y = float(rng.uniform(0.32, 0.66)), float(rng.uniform(-0.3, 0.3))
        z = float(rng.uniform(0.03, 0.25))
        tilt = rng.uniform(-0.35, 0.35, 2) if rng.random() < 0.5 else np.zeros(2)
        turned = (math.pi + float(tilt[0]), float(tilt[1]), float(rng.uniform(-1.5, 1.5)))
        return self.world.plan.reachable(Pose.from_rpy((x, y, z), turned))

    def _target(self, rng: np.random.Generator) -> tuple[str, Pose]:
        """Something believed, and the tool's pose in the middle of it."""
        from picktree.world import Pose

        world = self.world
        held = world.scene.held
        places: dict[str, Any] = {
            str(o.id): o.pose.position for o in world.scene.objects if o is not held and o.role == "item"
        }
        for name, bin_ in world.scene.bins.items():
            x, y, z = bin_.pose.position
            places[name] = (x, y + math.copysign(bin_.size[1] / 2, -y), z + 0.8 * bin_.size[2])
        places["post"] = world.scene.fixtures["post"].pose.position
        x, y, _ = world.control.tcp.position
        places["table"] = (x, y, -0.03)
        name = str(rng.choice(sorted(places)))
        return name, Pose(tuple(float(c) for c in places[name]), world.control.tcp.orientation)  # pyright: ignore[reportArgumentType]

    def _held_pair(self, name: str) -> tuple[tuple[str, str], ...]:
        held = self.world.scene.held
        return () if held is None else ((str(held.id), name),)

    def _drive(self, pose: Pose, speed: float) -> str:
        """Towards a pose, in joint space, until the guard stops it."""
        from picktree.robot.planning import Scaling, time_corners
        from picktree.world import Failure

        world = self.world
        q = world.control.held_position
        end = world.plan.solver.ik.descend(pose, q)
        if end is None:
            return "out of reach"
        timed = time_corners(world.robot, np.array([q, end]), Scaling(speed, speed), 0.1)
        if timed is None:
            return "cannot be timed"
        try:
            self._finish(world.move.along(timed, guard=25.0))
        except Failure as failure:
            return failure.cause.name
        return "arrived"

    def _grasp(self, rng: np.random.Generator) -> None:
        if self._in_hand() is not None and self.world.scene.held is not None:
            return
        lying = [str(o.id) for o in self.world.scene.objects if o.role == "item" and o.place == "table"]
        if not lying:
            return
        item = str(rng.choice(sorted(lying)))
        self.run.start(self.cell.mission(f"Grasp: {{object: {item}, onward: false}}"))
        self.run.finish()

    def _clean(self) -> None:
        """Clean up for the next state: take the obstacle away and look again."""
        thing = getattr(self, "thing", None)
        if thing is not None:
            self.run.hardware.take_obstacle(thing)
            self.thing = None
        for o in self.world.scene.objects:
            if o.role == "obstacle":
                self.world.scene.remove(o.id, "taken away by the campaign")
        self.run.start(self.cell.mission("Observe: {camera: overhead}"))
        self.run.finish()

    def _finish(self, doing: Generator[None, None, Any]) -> Any:
        while True:
            try:
                next(doing)
            except StopIteration as end:
                return end.value
            self.run.wait()


FINE = ("home", "refused", "lost")


def report(rows: list[Row], runs: int) -> tuple[str, bool]:
    states: list[dict[str, Any]] = [state for row in rows for state in row["states"]][:runs]
    lines = [f"{len(states)} retreats"]
    hands = ("empty", "keep", "open", "put_down")
    groups: dict[str, list[dict[str, Any]]] = {"all": states}
    groups |= {name: [s for s in states if s.get("class") == name] for name in CLASSES}
    groups |= {f"hand: {hand}": [s for s in states if s.get("hand") == hand] for hand in hands}
    groups["pressed before"] = [s for s in states if s.get("before", 0.0) > GONE]
    for name, some in groups.items():
        n = len(some)
        done = [s for s in some if "force" in s]
        forces = sorted(s["force"] for s in done) or [0.0]
        peaks = sorted(s["peak"] for s in done) or [0.0]
        seconds = sorted(s["seconds"] for s in done) or [0.0]
        lines += [
            name,
            rate("  home or honestly refused", sum(s["outcome"] in FINE for s in some), n),
            rate("  home", sum(s["outcome"] in ("home", "lost") for s in some), n),
            rate(f"  no contact above {LIMIT:.0f} N", sum(s["force"] <= LIMIT for s in done), len(done)),
            f"  force {forces[len(forces) // 2]:.1f} N median, {forces[-1]:.1f} N at most; in one step "
            f"{peaks[len(peaks) // 2]:.1f}, {peaks[-1]:.1f} N; "
            f"{seconds[len(seconds) // 2]:.1f} s median, {seconds[-1]:.1f} s at most",
        ]
    keep = [s for s in states if s.get("hand") == "keep"]
    lines.append(rate("kept what was to be kept", sum(s["kept"] for s in keep), len(keep)))
    lines.append(f"CPU {sum(s['cpu'] for s in states) / max(1, len(states)):.2f} s a state")
    for s in states:
        if s["outcome"] not in FINE or s["force"] > LIMIT:
            what = {
                k: s.get(k)
                for k in ("class", "hand", "made", "outcome", "cause", "force", "where", "message")
            }
            lines.append(f"  {s['number']}: {what}")
    fine = all(s["outcome"] in FINE and s["force"] <= LIMIT for s in states)
    return "\n".join(lines), fine


def main() -> int:
    given = options(__file__, __doc__, runs=1000, what=f"retreats, {STATES} in each seed").parse_args()
    rows = campaign(
        given,
        [Job(given.first + n, STATES) for n in range(math.ceil(given.runs / STATES))],
        one,
        cost=STATES * COST,
        short=lambda row: ", ".join(f"{s['outcome']} {s.get('force', '–')} N" for s in row["states"]),
    )
    text, fine = report(finished(rows), given.runs)
    print(text)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())

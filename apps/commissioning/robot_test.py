"""Self-test of a robot: checks of its file, then trials in physics, with a verdict a line and advice by the
measured cause.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Generator, Mapping
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from picktree.analysis.render import draw_robot
from picktree.files import PicktreeError, file_system
from picktree.recovery import SafeRetreat
from picktree.robot.control import static_external_torque
from picktree.robot.manipulation import MIN_SPARE_OPENING, grasp_candidates
from picktree.robot.perception import hidden_shares
from picktree.robot.planning import InverseKinematics, NamedGoal
from picktree.session import CellSession
from picktree.skills import Grasp, Observe, Place
from picktree.world import Array, BeliefObject, Failure, Pose, causes
from picktree.world.robot_model import GripperDescription, RobotDescription, RobotModel, load_robot
from picktree.world.scene import MAX_HIDDEN_SHARE

from .arm_poses import first_joint, reach
from .base_pose import HEIGHT_OVER_BIN, YAWS, TargetPlace, propose_base
from .model_checks import RobotUnderTest, Verdict, check_model

STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .5rem .7rem; border-bottom: 1px solid #8886; }
td { overflow-wrap: anywhere; }
td:first-child, td.good, td.bad { white-space: nowrap; }
td.good { color: #188038; font-weight: 600; }
td.bad { color: #c5221f; font-weight: 600; }
.change { margin-top: .25rem; font-weight: 600; }
.both { display: flex; flex-wrap: wrap; gap: 2rem; }
.both > :first-child { flex: 3 1 32rem; }
img { flex: 1 1 18rem; max-width: 26rem; align-self: flex-start; border-radius: .5rem; }
@media (prefers-color-scheme: dark) { td.good { color: #81c995; } td.bad { color: #f28b82; } }
"""


@dataclass(frozen=True, slots=True)
class RobotTestResult:
    """Verdicts of a self-test of one robot."""

    name: str
    file: str
    verdicts: tuple[Verdict, ...]

    @property
    def good(self) -> bool:
        return all(verdict.good for verdict in self.verdicts)

    @property
    def summary(self) -> str:
        """Sentence about all verdicts."""
        failed = [verdict.name for verdict in self.verdicts if not verdict.good]
        if not failed:
            return f"all {len(self.verdicts)} tests are passed"
        return f"{len(failed)} of {len(self.verdicts)} tests failed: {', '.join(failed)}"

    def to_text(self) -> str:
        lines = [f"{self.name}: {self.summary}"]
        width = max(len(verdict.name) for verdict in self.verdicts)
        for v in self.verdicts:
            lines.append(f"  {'ok    ' if v.good else 'FAILED'}  {v.name:<{width}}  {v.measured}")
            if v.change:
                lines.append(f"  {'':6}  {'':<{width}}  to change: {v.change}")
        return "\n".join(lines)

    def to_json_text(self) -> str:
        return json.dumps({**asdict(self), "good": self.good}, ensure_ascii=False)

    def write_page(self, robot: RobotDescription, file: Path) -> None:
        """Write the page, with the robot at `home`. Raises PicktreeError when it cannot be written."""
        with TemporaryDirectory() as folder:
            drawn = Path(folder) / "robot.png"
            draw_robot(robot, drawn)
            picture = base64.b64encode(drawn.read_bytes()).decode()
        with file_system.whole([file], file) as (beside,):
            beside.write_text(self.to_html(picture), encoding="utf-8")

    def to_html(self, picture: str) -> str:
        """Return the page; `picture`: a PNG in base 64."""
        rows = "\n".join(
            f"<tr><td>{escape(v.name)}</td>"
            f"<td class={'good' if v.good else 'bad'}>{'ok' if v.good else 'failed'}</td>"
            f"<td>{escape(v.measured)}"
            + (f'<div class="change">To change: {escape(v.change)}</div>' if v.change else "")
            + "</td></tr>"
            for v in self.verdicts
        )
        title = f"Self-test of {escape(self.name)}"
        return (
            f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{title}</title>\n'
            f"<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
            f"<p>{escape(self.file)}: {escape(self.summary)}.</p>\n"
            f'<div class="both"><table>\n<tr><th>Test</th><th>Verdict</th><th>Measured</th></tr>\n{rows}\n'
            f'</table><img alt="The robot at home, with base, flange and TCP" '
            f'src="data:image/png;base64,{picture}"></div>\n</body>\n</html>\n'
        )


DISTANCE_STEP = 0.02
"""Step of the distances at which the tool is held down, m."""
MAX_OVERHANG = 0.1
"""Distance beyond the measured reach up to which the tool is tried, m."""


def opening_advice(gripper: GripperDescription, item: BeliefObject, file: str) -> tuple[str, str] | None:
    """Return the opening for an item as text, and the necessary change; None: it opens far enough."""
    if grasp_candidates(item, gripper):
        return None
    wider = replace(gripper, max_width=1.0)
    width = min((grasp.expected_width for grasp in grasp_candidates(item, wider)), default=0.0)
    measured = (
        f"the gripper opens {1000 * gripper.max_width:.0f} mm; the {item.kind} is "
        f"{1000 * width:.0f} mm wide, and "
        f"needs {1000 * (width + MIN_SPARE_OPENING):.0f} mm"
    )
    change = (
        f"look at 'max_width' in {file}; if it is right, mount another gripper, or write a scene "
        "with smaller items"
    )
    return measured, change


def reach_advice(
    tested: RobotUnderTest, places: tuple[TargetPlace, ...], file: str
) -> tuple[str, str] | None:
    """Return the measured reach as text, and the necessary change; None: each place is within it.

    The reach is that of the tool pointing down, at the height of the place and in its direction.
    """
    model = tested.model
    for place in places:
        away = place.position[:2] - first_joint(model)[:2]
        distance = float(np.linalg.norm(away))
        span = _span(model, away / max(distance, 1e-9), float(place.position[2]))
        if span is None:
            measured = (
                f"with the tool down the arm reaches nothing {1000 * place.position[2]:.0f} mm "
                "above the table"
            )
            return measured, _other_base(tested, file)
        near, far = span
        if not near - DISTANCE_STEP <= distance <= far + DISTANCE_STEP:
            measured = (
                f"with the tool down the arm reaches from {near:.2f} to {far:.2f} m from its first joint; "
                f"{place.name} is at {distance:.2f} m"
            )
            return measured, _other_base(tested, file)
    return None


def _other_base(tested: RobotUnderTest, file: str) -> str:
    """Return the advice for an arm that is too short, or mounted too high or too low."""
    better = propose_base(tested.model, tested.skeleton, tested.solids)
    if better is None:
        return f"write a scene for that reach: no other 'base:' in {file} reaches more places of this scene"
    x, y, z = better.at
    return f"write 'at: [{x:g}, {y:g}, {z:g}]' under 'base:' in {file}: {better.sentence}"


def _span(model: RobotModel, direction: Array, height: float) -> tuple[float, float] | None:
    """Return the least and the greatest distance from the first joint, m, at which the tool points down."""
    ik, generator = InverseKinematics(model), np.random.default_rng(0)
    home, centre = model.named("home"), first_joint(model)[:2]
    found: list[float] = []
    for distance in np.arange(DISTANCE_STEP, reach(model) + MAX_OVERHANG, DISTANCE_STEP).tolist():
        x, y = (centre + distance * direction).tolist()
        poses = (Pose.from_rpy((x, y, height), (np.pi, 0.0, yaw)) for yaw in YAWS)
        if any(ik.solutions(pose, generator, home, 1) for pose in poses):
            found.append(distance)
    return (found[0], found[-1]) if found else None


def advice(cause: str, message: str, file: str, links: tuple[str, ...], bodies: tuple[str, ...]) -> str:
    """Return the necessary change after a failure with that cause and message.

    `links` are the robot's, `bodies` those of the scene.
    """
    told_links = [name for name in links if _names(message, name)]
    told_bodies = [name for name in bodies if _names(message, name)]
    if _TOUCH.search(message) and told_links:
        if told_bodies and cause.startswith(("grasp", "place")):
            return (
                f"look at the collision geometry of {told_links[0]} in the URDF, and at 'tip', 'palm' and "
                f"'hand' under 'gripper:' in {file}: it touches {told_bodies[0]}"
            )
        if told_bodies:
            return (
                f"choose other 'poses:' in {file}, or move its 'base:', so that {told_links[0]} keeps away "
                f"from {told_bodies[0]}"
            )
        if len(told_links) > 1:
            return (
                f"look at the collision geometry of {told_links[0]} and {told_links[1]} in the URDF, and at "
                f"'disabled_pairs:' in {file}"
            )
    for head, change in _CHANGES.items():
        if cause.startswith(head) or head in message:
            return change.format(file=file)
    return f"look at 'joints:' in {file}"


_TOUCH = re.compile(r" mm (deep|from|in each other|apart)")
_CHANGES: Mapping[str, str] = {
    "outside the workspace": "choose 'poses:' in {file} with the tool inside of the scene's workspace, or "
    "move 'base:'",
    "outside of the workspace": "choose 'poses:' in {file} with the tool inside of the scene's workspace, or "
    "move 'base:'",
    "safety.torque_limit": "compare 'torque' under 'joints:' in {file} with the data sheet, and masses under "
    "'inertias:'",
    "safety": "look at 'inertias:', and at 'velocity' and 'torque' under 'joints:' in {file}",
    "grasp": "look at 'pads:', 'palm' and 'tip' under 'gripper:', and at 'tcp:' in {file}",
    "place": "look at 'pads:' under 'gripper:', and at 'tcp:' in {file}",
    "planning": "look at 'poses:', 'base:' and 'disabled_pairs:' in {file}",
    "control": "look at 'acceleration' and 'torque' under 'joints:', and at 'inertias:' in {file}",
    "perception": "look at 'home' under 'poses:', and at 'base:' in {file}",
}
"""Changes by a part of the message, or by the beginning of the cause; more exact ones come first."""


def _names(message: str, name: str) -> bool:
    """Whether a message names a body as a word of its own."""
    return bool(name) and re.search(rf"(?<![\w/]){re.escape(name)}(?![\w/])", message) is not None


SCENE = "self_test"
REST_TIME = 1.0
"""Time for which the arm is held at `home`, s."""
MAX_UNEXPLAINED_SHARE, MIN_UNEXPLAINED = 0.02, 0.3
"""Greatest unexplained effort at rest: share of the joint's torque limit, and Nm."""
MAX_SAG = 0.002
"""Greatest distance of a joint from its held position, rad."""
MAX_TRACKING_ERROR = 0.02
"""Greatest distance of a joint from its set-point on a motion, rad."""
MAX_BRAKING_TIME = 1.0
"""Longest time in which the arm comes to rest from full speed, s."""
SHUT_OPENING = 0.003
"""Tolerance of the opening of closed fingers, and of fully open ones, m."""
CLOSING_FORCE = 10.0
"""Force with which the empty fingers close, N."""


def test_robot(name_or_path: str) -> RobotTestResult:
    """Test a robot's file and model, then the robot in physics, where its model allows that.

    Raises FileError with all faults of the file, PicktreeError for meshes that cannot be read.
    """
    robot = load_robot(name_or_path, Path.cwd())
    tested = RobotUnderTest.of(robot)
    verdicts = [*check_model(tested)]
    singular = np.linalg.eigvalsh(tested.model.mass_matrix(tested.model.named("home"))).min() <= 0.0
    trials = Trials(name_or_path, tested)
    for name, trial in trials.all():
        verdicts.append(
            Verdict(name, False, "not tried: a moving link has no mass", "see 'masses'")
            if singular
            else trials.verdict(name, trial)
        )
    return RobotTestResult(robot.name, robot.source, tuple(verdicts))


class Trials:
    """Trials of one robot in physics. They share a cell until one of them fails."""

    def __init__(self, robot: str, tested: RobotUnderTest) -> None:
        self._robot, self._tested = robot, tested
        self._cell: CellSession | None = None

    def all(self) -> tuple[tuple[str, Callable[[CellSession], Verdict]], ...]:
        """Return the trials with their names; a fault may explain the faults after it."""
        return (
            ("effort at rest", self._rest),
            ("track", self._track),
            ("brake", self._brake),
            ("soft retreat", self._retreat),
            ("open and close", self._grip),
            ("camera's view", self._view),
            ("grasp a block", lambda cell: self._grasp(cell, "block")),
            ("grasp a can", lambda cell: self._grasp(cell, "can")),
            ("grasp a plate", lambda cell: self._grasp(cell, "plate")),
        )

    def verdict(self, name: str, trial: Callable[[CellSession], Verdict]) -> Verdict:
        """Carry out one trial; a failure of the robot or its model is its verdict."""
        try:
            if self._cell is None:
                self._cell = CellSession(SCENE, robot=self._robot)
            verdict = trial(self._cell)
        except Failure as failure:
            verdict = self._failed(name, failure.cause.name, failure.message)
        except (PicktreeError, np.linalg.LinAlgError) as error:
            verdict = self._failed(name, "error", str(error))
        if not verdict.good:
            self._cell = None
        return verdict

    def _failed(self, name: str, cause: str, message: str, places: tuple[TargetPlace, ...] = ()) -> Verdict:
        measured, file = f"{cause}: {message}", self._tested.file
        if name in _OWN:
            return Verdict(name, False, measured, f"look at {_OWN[name]} in {file}")
        if "reach" in message and (found := reach_advice(self._tested, places, file)) is not None:
            return Verdict(name, False, f"{measured}; {found[0]}", found[1])
        scene = None if self._cell is None else self._cell.world.scene
        bodies = () if scene is None else (*scene.fixtures, *scene.bins, *(str(o.id) for o in scene.objects))
        return Verdict(
            name, False, measured, advice(cause, message, file, self._tested.skeleton.links, bodies)
        )

    def _rest(self, cell: CellSession) -> Verdict:
        world, model = cell.world, self._tested.model
        home, names = model.named("home"), self._tested.description.joints
        left: list[Array] = []
        for _ in cell_ticks(cell, REST_TIME):
            left.append(static_external_torque(model, world.control.state))
        residual = np.abs(np.mean(left[len(left) // 2 :], axis=0))
        bound = np.maximum(MAX_UNEXPLAINED_SHARE * model.torque_limit, MIN_UNEXPLAINED)
        k = int((residual / bound).argmax())
        sag = np.abs(world.control.state.position - home)
        if residual[k] > bound[k]:
            measured = f"{names[k]} exerts {residual[k]:.1f} Nm more or less than gravity explains"
            change = (
                f"look at <inertial> of the links beyond {names[k]} in the URDF, or at 'inertias:' in "
                f"{self._tested.file}"
            )
            return Verdict("effort at rest", False, measured, change)
        if sag.max() > MAX_SAG:
            k = int(sag.argmax())
            measured = f"{names[k]} sags by {1000 * sag[k]:.1f} mrad with {model.torque_limit[k]:g} Nm"
            change = f"raise 'torque' of {names[k]} in {self._tested.file}"
            return Verdict("effort at rest", False, measured, change)
        measured = f"within {residual.max():.2f} Nm of gravity; held within {1000 * sag.max():.2f} mrad"
        return Verdict("effort at rest", True, measured)

    def _track(self, cell: CellSession) -> Verdict:
        worst = np.zeros(self._tested.model.n)
        speed = 0.0
        for pose in (self._other_pose(), "home"):
            error, most = self._moved(cell, pose)
            worst, speed = np.maximum(worst, error), max(speed, most)
        k = int(worst.argmax())
        name = self._tested.description.joints[k]
        if worst[k] > MAX_TRACKING_ERROR:
            change = f"lower 'acceleration' of {name} in {self._tested.file}, or raise its 'torque'"
            return Verdict("track", False, f"{name} lags by {1000 * worst[k]:.1f} mrad", change)
        measured = f"within {1000 * worst[k]:.1f} mrad at {100 * speed:.0f} % of the joints' speeds"
        return Verdict("track", True, measured)

    def _moved(self, cell: CellSession, pose: str) -> tuple[Array, float]:
        """Move to a named pose. Return the greatest error (n,), rad, and speed as a share of the limits."""
        world, model = cell.world, self._tested.model
        plan = cell.perform(world.plan.to(NamedGoal(pose), node="track"))
        worst, speed = np.zeros(model.n), 0.0

        def watched() -> Generator[None]:
            nonlocal worst, speed
            for _ in world.move.along(plan.trajectory, node="track"):
                state, reference = world.control.state, world.control.reference
                if reference is not None:
                    worst = np.maximum(worst, np.abs(reference - state.position))
                speed = max(speed, float((np.abs(state.velocity) / model.velocity_limit).max()))
                yield

        cell.perform(watched())
        return worst, speed

    def _other_pose(self) -> str:
        """Return a named pose other than `home`; `home` without another one."""
        home, named = self._tested.model.named("home"), self._tested.description.named
        others = (name for name in ("observe", "rest") if name in named)
        return next((name for name in others if not np.allclose(named[name], home)), "home")

    def _brake(self, cell: CellSession) -> Verdict:
        world, model = cell.world, self._tested.model
        plan = cell.perform(world.plan.to(NamedGoal(self._other_pose()), node="brake"))
        speeds = np.abs(plan.trajectory.velocity).max(axis=1)
        fastest = float(plan.trajectory.times[int(speeds.argmax())])

        def braked() -> Generator[None, None, tuple[float, float]]:
            motion = world.move.along(plan.trajectory, node="brake")
            begun = cell.time
            for _ in motion:
                if cell.time - begun >= fastest:
                    break
                yield
            speed = float((np.abs(world.control.state.velocity) / model.velocity_limit).max())
            motion.close()
            begun = cell.time
            while not world.control.at_rest and cell.time - begun < 3 * MAX_BRAKING_TIME:
                yield
            return speed, cell.time - begun

        speed, took = cell.perform(braked())
        measured = f"at rest {took:.2f} s after {100 * speed:.0f} % of the joints' speeds"
        change = f"lower 'velocity' or raise 'acceleration' and 'torque' in {self._tested.file}"
        return Verdict("brake", took <= MAX_BRAKING_TIME, measured, change if took > MAX_BRAKING_TIME else "")

    def _retreat(self, cell: CellSession) -> Verdict:
        result = cell.run(SafeRetreat())
        if not result:
            return self._failed("soft retreat", result.cause, result.message)
        left = np.abs(cell.world.control.state.position - self._tested.model.named("home")).max()
        measured = f"home after {result.seconds:.1f} s, within {1000 * left:.1f} mrad"
        return Verdict("soft retreat", True, measured)

    def _grip(self, cell: CellSession) -> Verdict:
        gripper, hand = self._tested.description.gripper, cell.world.gripper
        begun = cell.time
        shut = cell.perform(hand.close(CLOSING_FORCE))
        took = cell.time - begun
        cell.perform(hand.open())
        measured = f"shut at {1000 * shut:.1f} mm after {took:.2f} s, open at {1000 * hand.width:.1f} mm"
        good = shut <= gripper.min_width + SHUT_OPENING and (
            abs(hand.width - gripper.max_width) <= SHUT_OPENING
        )
        change = f"look at 'pads:', 'max_width' and 'linkage:' under 'gripper:' in {self._tested.file}"
        return Verdict("open and close", good, measured, "" if good else change)

    def _view(self, cell: CellSession) -> Verdict:
        shares = hidden_shares(self._tested.model, cell.world.description, self._tested.model.named("home"))
        measured = ", ".join(f"{name}: the arm hides {100 * share:.0f} %" for name, share in shares.items())
        good = all(share <= MAX_HIDDEN_SHARE for share in shares.values())
        change = (
            f"choose another 'home' under 'poses:' in {self._tested.file}: its arm is in the camera's view, "
            "and nothing below it is seen"
        )
        measured += " of the items' part of the table"
        return Verdict("camera's view", good, measured, "" if good else change)

    def _grasp(self, cell: CellSession, kind: str) -> Verdict:
        """Grasp an item and put it into its bin. After a touch on the way it retreats and tries once more: a
        hand that leaves a bin may touch the items there."""
        name = f"grasp a {kind}"
        verdict, cause = self._grasped(cell, kind, name)
        if cause == causes.world.DISTURBED.name and cell.run(SafeRetreat()):
            verdict, _ = self._grasped(cell, kind, name)
        return verdict

    def _grasped(self, cell: CellSession, kind: str, name: str) -> tuple[Verdict, str]:
        """Return the verdict of one attempt, and the cause of its failure."""
        cell.run(Observe())
        found = next((o for o in cell.world.scene.objects if o.kind == kind), None)
        if found is None:
            change = f"see 'camera's view'; if that test passes, look at 'base:' in {self._tested.file}"
            return Verdict(name, False, f"no {kind} is seen", change), ""
        tested = self._tested
        if (narrow := opening_advice(tested.description.gripper, found, tested.file)) is not None:
            return Verdict(name, False, *narrow), ""
        into = cell.world.scene.destination(found.id)
        bin_ = next(b for b in cell.world.description.bins if b.id == into)
        places = (
            TargetPlace(found.id, np.array(found.pose.position)),
            TargetPlace(bin_.id, bin_.pose.apply(np.array([0.0, 0.0, bin_.size[2] + HEIGHT_OVER_BIN]))),
        )
        steps = (Grasp(object=found.id), Place(object=found.id, into=bin_.id))
        result = next((r for r in map(cell.run, steps) if not r), None)
        if result is not None:
            return self._failed(name, result.cause, result.message, places), result.cause
        measured = f"held and put into its bin, {cell.time:.1f} s after the cell's start"
        return Verdict(name, True, measured), ""


_OWN = {"open and close": "'gripper:'", "camera's view": "'home' under 'poses:'"}
"""Entry of a robot file that is responsible for a trial's failure, for any cause."""


def cell_ticks(cell: CellSession, seconds: float) -> Generator[None]:
    """Let `seconds` of simulated time pass, and yield after each tick."""

    def one_tick() -> Generator[None]:
        yield

    until = cell.time + seconds
    while cell.time < until - 1e-9:
        cell.perform(one_tick())
        yield

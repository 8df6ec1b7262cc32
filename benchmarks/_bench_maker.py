"""Problems of MotionBenchMaker as planning scenes and requests.

Chamzas et al., "MotionBenchMaker: a tool to generate and benchmark motion planning datasets", IEEE Robotics
and Automation Letters 7 (2022). One archive holds NAME_panda/sceneNNNN.yaml (MoveIt's planning scene) and
requestNNNN.yaml (start state and joint goal).
"""

from __future__ import annotations

import re
import tarfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from picktree.robot.planning import CollisionChecker
from picktree.robot.planning.collision_model import CollisionMargins
from picktree.world import Array, Box, Cylinder, ObjectId, PlanningScene, Pose, Shape, Sphere
from picktree.world.robot_model import RobotModel
from picktree.world.scene import Fixture

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parent.parent
PLACES = (ROOT.parent / "shared/data", ROOT / "../shared/data")
ARCHIVE = "motion_bench_maker.tar.bz2"
SCENES = {
    "table_pick": "table",
    "table_under_pick": "under the table",
    "bookshelf_small": "bookshelf, small",
    "bookshelf_tall": "bookshelf, tall",
    "bookshelf_thin": "bookshelf, thin",
    "box": "box",
    "cage": "cage",
}
WANTED = 0.005
"""The margin that is asked for, m."""
GRAIN = 0.0001
"""To what margins are rounded down, m."""
GRASPED = {"cage": "Cube1"}
"""What the goal has between its fingers: they may touch it."""

# What is read here is MoveIt's YAML, of which nothing is declared.
Yaml = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One request: from `start` to `goal`, both (n,) rad, with the fingers `width` m open."""

    scene: str
    number: int
    world: PlanningScene
    start: Array
    goal: Array
    width: float
    allowed: tuple[tuple[str, str], ...]

    @property
    def name(self) -> str:
        return f"{self.scene} {self.number:04}"


def archive(given: Path | None) -> Path | None:
    """The file to read: the one given, else the one beside the project, else None."""
    if given is not None:
        return given / ARCHIVE if given.is_dir() else given
    return next((place / ARCHIVE for place in PLACES if (place / ARCHIVE).exists()), None)


def required_archive(given: Path | None) -> Path | None:
    """Return the file to read. None: there is none, which is printed."""
    path = archive(given)
    if path is not None and path.exists():
        return path
    where = "beside the project" if path is None else str(path)
    print(f"no {ARCHIVE} {where}: nothing to do; --data FOLDER says where it is")
    return None


def problems(path: Path, scene: str, first: int, count: int, model: RobotModel) -> list[Problem]:
    """Return `count` problems of a scene, from the one at index `first` on."""
    texts: dict[tuple[str, int], str] = {}
    with tarfile.open(path) as tar:
        for member in tar:
            found = re.search(r"(\w+)_panda/(scene|request)(\d+)\.yaml$", member.name)
            content = tar.extractfile(member) if found else None
            if found and content is not None and found[1] == scene:
                texts[found[2], int(found[3])] = content.read().decode()
    numbers = sorted(number for kind, number in texts if kind == "scene")[first : first + count]
    return [_problem(scene, k, _load(texts["scene", k]), _load(texts["request", k]), model) for k in numbers]


def beyond_limits(problem: Problem, model: RobotModel) -> str:
    """Which joints of the start or the goal lie outside the limits of the robot file; "" for none."""
    told: list[str] = []
    for what, q in (("start", problem.start), ("goal", problem.goal)):
        for joint, value, low, high in zip(
            model.description.joints, q, model.lower, model.upper, strict=True
        ):
            if not low <= value <= high:
                told.append(f"{joint} of the {what} is {value:.4f} rad, allowed are {low:g} … {high:g}")
    return "; ".join(told)


def admitted(problem: Problem, model: RobotModel) -> float:
    """The largest margin up to WANTED that the goal keeps, m; negative: how deep it penetrates."""
    collision = CollisionChecker(model, CollisionMargins(WANTED, WANTED, WANTED, WANTED))
    collision.update(problem.world.supposing(allowed=problem.allowed), problem.width)
    least = [contact.distance for contact in collision.contacts(problem.goal)]
    # Two ways to measure differ in the last digits: half a grain is left between them.
    return min([WANTED] + [float(np.floor((d - GRAIN / 2) / GRAIN)) * GRAIN for d in least])


def _load(text: str) -> Yaml:
    return yaml.load(text, yaml.CSafeLoader)


def _problem(scene: str, number: int, world: Yaml, request: Yaml, model: RobotModel) -> Problem:
    state = request["start_state"]["joint_state"]
    at = dict(zip(state["name"], state["position"], strict=True))
    (constraints,) = request["goal_constraints"]
    to = {c["joint_name"]: c["position"] for c in constraints["joint_constraints"]}
    joints, gripper = model.description.joints, model.description.gripper
    opening = sum(at[joint] for joint in gripper.joints)
    grasped = GRASPED.get(scene)
    return Problem(
        scene,
        number,
        PlanningScene([body for thing in world["world"]["collision_objects"] for body in _bodies(thing)], ()),
        np.array([float(at[joint]) for joint in joints]),
        np.array([float(to[joint]) for joint in joints]),
        min(opening, gripper.max_width),
        tuple((finger, grasped) for finger in gripper.fingers) if grasped else (),
    )


def _bodies(thing: Yaml) -> list[Fixture]:
    name, made = str(thing["id"]), list[Fixture]()
    for k, (primitive, at) in enumerate(zip(thing["primitives"], thing["primitive_poses"], strict=True)):
        x, y, z = (float(c) for c in at["position"])
        qx, qy, qz, qw = (float(c) for c in at["orientation"])
        pose = Pose((x, y, z), (qx, qy, qz, qw))
        made.append(Fixture(ObjectId(f"{name}/{k}" if k else name), _shape(primitive), pose))
    return made


def _shape(primitive: Yaml) -> Shape:
    size = [float(d) for d in primitive["dimensions"]]
    match primitive["type"], size:
        case "box", [x, y, z]:
            return Box((x, y, z))
        case "cylinder", [length, radius]:
            return Cylinder(radius, length)
        case "sphere", [radius]:
            return Sphere(radius)
        case kind, _:
            raise ValueError(f"no {kind} of {len(size)} dimensions is known")

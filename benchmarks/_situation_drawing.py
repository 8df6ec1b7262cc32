"""Drawing of situations: a cell (mission, scene, robot, backend, seed), and up to three deviations.

A draw depends on its seed alone. `SHARED` consecutive seeds have the same cell, and so the same clean run.
The times of faults are drawn as places in that run, and become absolute times when it is known.
"""

from __future__ import annotations

import copy
import math
import random
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeAlias

from picktree.authoring import check_mission
from picktree.files import PicktreeError
from picktree.files.yaml import read_document
from picktree.simulation import Backend, spawn_items
from picktree.trees.loading import scene_names
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

import yaml

ROOT = Path(__file__).resolve().parent.parent
DEVELOPMENT = range(100_000)
"""Seeds of development draws: their cases may be read, and rules and confidences fitted on them."""
FINAL = range(1_000_000, 1_100_000)
"""Seeds of final draws. A final draw is made once, at the end of the work that it measures. Its cases are
read only after its figures are written down; then they are development situations."""
SHARED = 3
"""Number of consecutive seeds with the same cell."""
LIMIT = 90.0
"""Limit of a run, simulated s."""
MAX_ITEMS = 6

Tree: TypeAlias = dict[str, Any]
Where: TypeAlias = Literal["fault", "scene", "mission"]
ROBOTS = ("panda", "panda_long_fingers", "xarm6", "iiwa", "gen3", "ur10e")
BINS = ("red_bin", "green_bin", "blue_bin")
COLOURS = ("red", "green", "blue")


@dataclass(frozen=True)
class Operation:
    """Change of a YAML tree: `set`, `delete`, `insert` into a list, `swap` with the next entry of a list, or
    `wrap`: the present value replaces `<old>` in `value`."""

    op: Literal["set", "delete", "insert", "swap", "wrap"]
    at: tuple[str | int, ...]
    value: Any = None

    def apply(self, tree: Tree) -> None:
        """Change the tree in place. Raises KeyError or IndexError when it has no such place."""
        owner: Any = tree
        for key in self.at[:-1]:
            if isinstance(owner, dict) and self.op == "set" and key not in owner:
                owner[key] = {}
            owner = owner[key]
        last: Any = self.at[-1]
        match self.op:
            case "set":
                owner[last] = copy.deepcopy(self.value)
            case "delete":
                del owner[last]
            case "insert":
                owner.insert(last, copy.deepcopy(self.value))
            case "swap":
                owner[last], owner[last + 1] = owner[last + 1], owner[last]
            case "wrap":
                owner[last] = _filled(self.value, owner[last])


def _filled(value: Any, old: Any) -> Any:
    if value == "<old>":
        return old
    if isinstance(value, dict):
        return {key: _filled(each, old) for key, each in value.items()}
    return [_filled(each, old) for each in value] if isinstance(value, list) else value


@dataclass(frozen=True)
class Occasion:
    """Place in the clean run at which a fault strikes."""

    share: float
    """Share of the run's time; with a skill, share of the skill's visit."""
    skills: tuple[str, ...] = ()
    """Skills of whose visits one is drawn; empty: any time of the run."""
    visit: float = 0.0
    """Which of these visits, as a share of their number."""


@dataclass(frozen=True)
class Deviation:
    """Deviation from the cell. It can be switched off without a change of anything else."""

    kind: str
    where: Where
    entry: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Entry of a faults file without `when`; `target: {}` is the item of the drawn visit."""
    occasion: Occasion | None = None
    """None: a fault strikes at the beginning."""
    operations: tuple[Operation, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    """Words by which a root cause may name what deviates: `joint`, `bin`, `camera`, `body`, `node`."""
    magnitude: float | None = None
    """Magnitude in the unit of the table of answers."""


@dataclass(frozen=True)
class Cell:
    """Mission and scene as YAML trees, with robot, backend and seed."""

    family: str
    mission: Mapping[str, Any]
    scene: Mapping[str, Any]
    robot: str
    backend: Backend
    seed: int


@dataclass(frozen=True)
class Situation:
    """Cell with its deviations, and how its run ends."""

    seed: int
    cell: Cell
    deviations: tuple[Deviation, ...]
    resumed: float | None = None
    """Share of the run at which its process is killed; it is resumed, and the later log explained. None: it
    runs in one go."""

    def trees(self, present: Sequence[int]) -> tuple[Tree, Tree]:
        """Return mission and scene with the deviations of these numbers."""
        mission, scene = copy.deepcopy(dict(self.cell.mission)), copy.deepcopy(dict(self.cell.scene))
        for number in present:
            deviation = self.deviations[number]
            for operation in deviation.operations:
                operation.apply(mission if deviation.where == "mission" else scene)
        return mission, scene


@cache
def drawn(seed: int) -> Situation:
    """Return the situation of a seed."""
    cell = drawn_cell(seed // SHARED)
    rng = random.Random(f"situation {seed}")
    number = rng.choices((0, 1, 2, 3), (12, 46, 28, 14))[0]
    found: list[Deviation] = []
    for _ in range(20 * number):
        if len(found) == number:
            break
        one = _deviation(rng, cell)
        if one is not None and _fits(one, found) and _loads(cell, (*found, one)):
            found.append(one)
    killed = any(each.kind == "kill" for each in found)
    resumed = rng.uniform(0.3, 0.9) if found and not killed and rng.random() < 0.08 else None
    return Situation(seed, cell, tuple(found), resumed)


def _fits(one: Deviation, others: Sequence[Deviation]) -> bool:
    """Return whether a deviation may be added: no kind twice, one change of the mission, a kill alone."""
    if any(each.kind == one.kind for each in others):
        return False
    if "kill" in (one.kind, *(each.kind for each in others)) and others:
        return False
    return one.where != "mission" or all(each.where != "mission" for each in others)


def _loads(cell: Cell, deviations: tuple[Deviation, ...]) -> bool:
    """Return whether mission and scene have no error with these deviations."""
    if all(each.where == "fault" for each in deviations):
        return True
    try:
        mission, scene = Situation(0, cell, deviations).trees(range(len(deviations)))
        check(mission, scene, cell)
    except (PicktreeError, KeyError, IndexError, TypeError):
        return False
    return True


def check(mission: Tree, scene: Tree, cell: Cell) -> None:
    """Raise PicktreeError when a mission, its scene or the places of its items have an error."""
    with tempfile.TemporaryDirectory(prefix="situation-") as folder:
        path = Path(folder) / "mission.yaml"
        write(mission, scene, Path(folder))
        known = load_scene("scene.yaml", Path(folder))
        spawn_items(known, cell.seed)
        robot = load_robot(cell.robot, Path(folder))
        check_mission(read_document(path, "mission"), known=scene_names(known, robot)).required()


def write(mission: Tree, scene: Tree, folder: Path) -> None:
    """Write both files into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene, sort_keys=False))
    (folder / "mission.yaml").write_text(yaml.safe_dump(mission, sort_keys=False))


_FAMILIES: Mapping[str, float] = {
    "shipped sort": 30, "drawn sort": 28, "feed": 7, "belt": 7, "insert": 11, "kit": 5, "push": 7, "heap": 5,
}  # fmt: skip
"""Families of cells, and the weight of each in a draw."""
_SORTING = ("sort_by_colour", "sort_tirelessly", "one_pick", "sort_past_obstacles", "02_each_item",
            "06_retry", "07_handler", "10_recover")  # fmt: skip
_SCENES: Mapping[str, tuple[str, ...]] = {
    "three_bins": ("block", "brick", "can", "ball", "plate", "nut"),
    "heavy": ("ingot", "crate", "weight", "soap", "marble"),
    "light": ("foam", "carton", "can", "ball", "lid"),
    "fragile": ("cup", "bulb", "egg", "carton"),
    "parts": ("ring", "cup", "bracket", "screw", "disc"),
    "tall": ("bottle", "post"),
    "thin": ("card", "tile"),
}
"""Shipped scenes on which drawn ones are laid, with the kinds of their items."""
_SCENE_WEIGHTS = (64, 8, 5, 6, 7, 5, 5)
_PEGS = ("dowel_30", "dowel_40", "post_30", "post_40", "key_50", "key_36")


@cache
def drawn_cell(number: int) -> Cell:
    """Return the cell of a number. Its files have no error."""
    for attempt in range(50):
        rng = random.Random(f"cell {number} {attempt}")
        family = rng.choices(tuple(_FAMILIES), tuple(_FAMILIES.values()))[0]
        mission, scene, robots, backends = _FAMILY[family](rng)
        scene = {"picktree": 1, "kind": "scene", **scene, "checkpoint_every": 1}
        mission = {**mission, "scene": "scene.yaml"}
        cell = Cell(
            family, mission, scene, rng.choice(robots), rng.choice(backends), rng.randrange(1, 1_000_000)
        )
        if _loads(cell, (Deviation("", "scene"),)):
            return cell
    raise ValueError(f"cell {number}: no draw of 50 has files without an error")


_Drawn: TypeAlias = tuple[Tree, Tree, Sequence[str], Sequence[Backend]]
_BOTH: Sequence[Backend] = ("physics", "kinematic")


def _shipped(name: str) -> Tree:
    return yaml.safe_load((ROOT / "examples" / f"{name}.yaml").read_text(encoding="utf-8"))


def _table_scene(rng: random.Random, base: str = "", *, touching: bool = False) -> Tree:
    """Return a scene with two to six items on the table."""
    base = base or rng.choices(tuple(_SCENES), _SCENE_WEIGHTS)[0]
    kinds = _SCENES[base]
    number = rng.randint(2, MAX_ITEMS if rng.random() < 0.3 else 4)
    counts: dict[str, int] = {}
    for _ in range(number):
        kind = rng.choice(kinds)
        counts[kind] = counts.get(kind, 0) + 1
    spawn: Tree = {
        "of": counts,
        "colours": list(rng.sample(COLOURS, rng.choice((2, 3)))),
        "area": {
            "min": [0.37, round(rng.uniform(-0.25, -0.18), 3)],
            "max": [0.63, round(rng.uniform(0.18, 0.25), 3)],
        },
    }
    spawn |= {"touching": True} if touching else {"gap": f"{rng.randint(20, 60)} mm"}
    if not touching and rng.random() < 0.3:
        spawn["lying"] = round(rng.uniform(0.2, 1.0), 2)
    return {"base": base, "spawn": [spawn]}


def _shipped_sort(rng: random.Random) -> _Drawn:
    return _shipped(rng.choice(_SORTING)), _table_scene(rng), ROBOTS, _BOTH


def _drawn_sort(rng: random.Random) -> _Drawn:
    """Return a mission with drawn rounds, attempts, handlers and wrappings."""
    take: list[Any] = [
        {"Grasp": {"object": "{item}"}},
        {"Place": {"object": "{item}", "into": "{item.destination}"}},
    ]
    look = {"Observe": {"camera": "overhead"}}
    handlers = {
        "grasp.missed": ["SafeRetreat", look],
        "grasp.slipped": ["SafeRetreat", look],
        "grasp.no_candidate": [look],
        "world.*": ["SafeRetreat", look],
        "control.*": ["SafeRetreat"],
        "safety.*": ["SafeRetreat", look],
        "planning.*": ["SafeRetreat", look],
        "internal.error": ["SafeRetreat"],
    }
    chosen = {key: handlers[key] for key in handlers if rng.random() < 0.6}
    one: Tree = {"Sequence": take}
    style = rng.choice(("recover", "recover", "plain", "retry"))
    if style == "recover":
        one = {"Recover": {
            "attempts": rng.randint(2, 4), "do": one, **({"when": chosen} if chosen else {}),
            "otherwise": ["SafeRetreat"], "give_up": [{"SafeRetreat": {"hand": "open"}}],
        }}  # fmt: skip
    elif style == "retry":
        one = {"RetryUntilSuccessful": {"num_attempts": rng.randint(2, 3), "do": one}}
    each: Tree = {
        "ForEach": {
            "in": "{items}",
            "out": "{item}",
            "on_failure": "continue",
            "do": {"SortOne": {"item": "{item}"}},
        }
    }
    home: Tree = {"Fallback": [{"GoTo": {"pose": "home"}}, "SafeRetreat"]}
    steps: list[Any] = [{"Observe": {"camera": "overhead", "objects": "{items}"}}, each, home]
    main: Tree = {"Sequence": steps}
    if rng.random() < 0.7:
        main = {"Repeat": {"while": "items_left", "num_cycles": rng.randint(2, 3), "do": main}}
    mission = {
        "picktree": 1, "kind": "mission", "name": "drawn sort",
        "trees": {"Main": main, "SortOne": {"ports": {"item": {"type": "object"}}, **one}},
    }  # fmt: skip
    return mission, _table_scene(rng), ROBOTS, _BOTH


def _feed(rng: random.Random) -> _Drawn:
    kinds = rng.sample(("block", "brick", "can", "ball", "plate"), rng.randint(2, 3))
    load = {"of": dict.fromkeys(kinds, 1), "colours": list(COLOURS), "gap": "35 mm", "when": "clear",
            "area": {"min": [0.38, -0.22], "max": [0.63, 0.22]},
            "total": len(kinds) * rng.randint(1, 2)}  # fmt: skip
    scene = {"base": "continuous", "feed": [load]}
    return _shipped("continuous_sort"), scene, ROBOTS, _BOTH


def _belt(rng: random.Random) -> _Drawn:
    load = {"of": {"block": 2, "brick": 2, "can": 3, "ball": 1}, "colours": list(COLOURS), "belt": "belt",
            "spacing": f"{rng.randint(150, 260)} mm", "total": rng.randint(3, 4)}  # fmt: skip
    return _shipped("sort_from_belt"), {"base": "belt", "feed": [load]}, ROBOTS, _BOTH


def _insert(rng: random.Random) -> _Drawn:
    kinds = rng.sample(_PEGS, rng.randint(1, 3))
    spawn = {"of": dict.fromkeys(kinds, 1), "colours": list(COLOURS),
             "area": {"min": [0.36, -0.08], "max": [0.62, 0.28]}, "gap": "45 mm"}  # fmt: skip
    return _shipped("insert_pegs"), {"base": "pegs", "spawn": [spawn]}, ROBOTS, _BOTH


def _kit(rng: random.Random) -> _Drawn:
    counts = dict.fromkeys(rng.sample(("block", "can", "ball"), rng.randint(1, 2)), 1)
    counts |= dict.fromkeys(rng.sample(("housing", "cover"), rng.randint(1, 2)), 1)
    spawn = {"of": counts, "colours": list(COLOURS), "area": {"min": [0.36, -0.22], "max": [0.64, 0.24]},
             "gap": "45 mm"}  # fmt: skip
    return _shipped("kitting"), {"base": "kit", "spawn": [spawn]}, ROBOTS, _BOTH


def _push(rng: random.Random) -> _Drawn:
    """Return items that touch and have to be pushed apart, or one that is pushed to a place."""
    if rng.random() < 0.5:
        spawn = {"of": {"block": rng.randint(1, 2), "brick": rng.randint(1, 2)}, "colours": ["red", "green"],
                 "area": {"min": [0.40, -0.15], "max": [0.62, 0.15]}, "touching": True}  # fmt: skip
        return _shipped("sort_by_colour"), {"base": "touching", "spawn": [spawn]}, ROBOTS, ("physics",)
    to = [round(rng.uniform(0.42, 0.58), 3), round(rng.uniform(-0.15, 0.15), 3)]
    do = {"Sequence": [{"Push": {"object": "{item}", "to": to, "tolerance": "5 mm"}},
                       {"Grasp": {"object": "{item}"}},
                       {"Place": {"object": "{item}", "into": "{item.destination}"}}]}  # fmt: skip
    steps = [{"Observe": {"camera": "overhead", "objects": "{items}"}},
             {"ForEach": {"in": "{items}", "out": "{item}", "on_failure": "continue",
                          "do": {"Fallback": [do, "SafeRetreat"]}}}]  # fmt: skip
    mission = {
        "picktree": 1,
        "kind": "mission",
        "name": "push and sort",
        "trees": {"Main": {"Sequence": steps}},
    }
    spawn = {"of": {rng.choice(("block", "brick", "plate", "can")): 1}, "colours": [rng.choice(COLOURS)],
             "area": {"min": [0.42, -0.15], "max": [0.58, 0.15]}}  # fmt: skip
    return mission, {"base": "three_bins", "spawn": [spawn]}, ROBOTS, ("physics",)


def _heap(rng: random.Random) -> _Drawn:
    number = rng.randint(2, 4)
    name, base = rng.choice(
        (("clear_the_pile", "pile"), ("empty_the_tote", "tote"), ("feed_from_totes", "totes"))
    )
    load: Tree = {"of": {"assortment": number}, "colours": ["red", "blue", "yellow"]}
    load |= {"area": {"min": [0.40, -0.10], "max": [0.60, 0.10]}, "drop": "pile"} if base == "pile" else {
        "into": "tote", "drop": "heap"}  # fmt: skip
    scene: Tree = {"base": base, "spawn": [load]}
    if base == "totes":
        scene["feed"] = [
            {"of": {"assortment": 2}, "colours": ["red", "blue", "yellow"], "into": "tote", "total": 2}
        ]
    return _shipped(name), scene, ("panda_long_fingers",), ("physics",)


_FAMILY = {
    "shipped sort": _shipped_sort, "drawn sort": _drawn_sort, "feed": _feed, "belt": _belt, "insert": _insert,
    "kit": _kit, "push": _push, "heap": _heap,
}  # fmt: skip


def _deviation(rng: random.Random, cell: Cell) -> Deviation | None:
    """Return a drawn deviation; None when the drawn kind does not fit the cell."""
    where = rng.choices(("fault", "scene", "mission"), (64, 24, 12))[0]
    if where == "fault":
        return _fault(rng, cell)
    if where == "scene":
        return _scene_change(rng, cell)
    found = list(mission_changes(rng, cell))
    kinds = sorted({each.kind for each in found})
    if not kinds:
        return None
    kind = rng.choices(kinds, [_OFTEN_HARMLESS.get(each, 1.0) for each in kinds])[0]
    return rng.choice([each for each in found if each.kind == kind])


_OFTEN_HARMLESS: Mapping[str, float] = {"handler": 0.5, "look_left_out": 0.6, "attempts": 0.5, "budget": 0.7}
"""Weight of changes of a mission that alone seldom do harm; all others weigh 1."""


def _between(rng: random.Random, low: float, high: float, digits: int = 3) -> float:
    """Return a number that is evenly distributed by its logarithm."""
    return round(math.exp(rng.uniform(math.log(low), math.log(high))), digits)


_GRASPING, _CARRYING = ("Grasp", "PickAny"), ("Place", "Insert")
_MOVING = ("Grasp", "PickAny", "Place", "Insert", "Push", "GoTo", "Stir")
_LOOKING = ("Observe", "Grasp", "PickAny", "Push")
FAULT_WEIGHTS: Mapping[str, float] = {
    "remove": 5, "friction": 5, "bump": 6, "obstacle": 6, "slip": 5, "appear": 3, "heavier": 6, "larger": 5,
    "gripper_jam": 5, "gripper_weak": 5, "camera_drop": 3, "camera_shift": 6, "camera_noise": 4,
    "camera_mislabel": 4, "wrench_bias": 6, "wrench_dead": 4, "joint_weak": 6, "stall": 4, "no_plan": 3,
    "hang": 3, "raise": 3, "kill": 2,
}  # fmt: skip
"""Kinds of faults, and the weight of each in a draw."""
_AIMED: Mapping[str, tuple[str, ...]] = {
    "remove": _GRASPING + _CARRYING, "bump": _GRASPING + _CARRYING, "slip": _CARRYING, "friction": _GRASPING,
    "heavier": _GRASPING, "larger": _GRASPING, "gripper_jam": _GRASPING + _CARRYING,
    "gripper_weak": _GRASPING + _CARRYING, "camera_drop": _LOOKING, "camera_shift": _LOOKING,
    "camera_noise": _LOOKING, "camera_mislabel": _LOOKING, "wrench_bias": _MOVING, "wrench_dead": _MOVING,
    "joint_weak": _MOVING, "stall": _MOVING, "no_plan": _MOVING, "hang": _MOVING, "raise": _MOVING,
    "obstacle": _MOVING, "appear": _MOVING, "kill": _MOVING,
}  # fmt: skip
"""Skills during which a fault strikes, if its time is not drawn from the whole run."""
_AT_THE_BEGINNING = ("friction", "heavier", "larger", "camera_shift", "camera_noise", "camera_mislabel",
                     "wrench_bias", "gripper_weak", "joint_weak")  # fmt: skip
"""Faults that may hold from the beginning: a wrong catalogue, or a device that was never right."""


def _fault(rng: random.Random, cell: Cell) -> Deviation:
    kind = rng.choices(tuple(FAULT_WEIGHTS), tuple(FAULT_WEIGHTS.values()))[0]
    way = rng.random()
    occasion: Occasion | None = Occasion(round(rng.uniform(0.0, 0.95), 4))
    if way < 0.85:
        occasion = Occasion(round(rng.random(), 4), _AIMED[kind], round(rng.random(), 4))
    if kind in _AT_THE_BEGINNING and way > 0.7:
        occasion = None
    entry, names, magnitude = _fault_entry(rng, kind, cell)
    return Deviation(kind, "fault", {"fault": kind, **entry}, occasion, names=names, magnitude=magnitude)


def _lasting(rng: random.Random, low: float, high: float) -> Tree:
    """Return for how long a fault lasts: for good, or a drawn time."""
    return {} if rng.random() < 0.45 else {"lasts": f"{_between(rng, low, high, 2)} s"}


def _vector(rng: random.Random, length: float, flat: bool = False) -> list[float]:
    """Return a vector of that length in any direction, or in any horizontal one."""
    turn, up = rng.uniform(-math.pi, math.pi), 0.0 if flat else rng.uniform(-1.0, 1.0)
    side = math.sqrt(1.0 - up * up)
    return [round(length * c, 4) for c in (side * math.cos(turn), side * math.sin(turn), up)]


def _fault_entry(rng: random.Random, kind: str, cell: Cell) -> tuple[Tree, dict[str, str], float | None]:
    """Return the parameters of a fault, the words that name it, and its magnitude."""
    camera = {"camera": "camera|overhead"}
    target: Tree = {"target": {}}
    match kind:
        case "remove":
            return target, {}, None
        case "friction":
            return {**target, "friction": _between(rng, 0.004, 0.4)}, {}, None
        case "bump":
            velocity = _vector(rng, _between(rng, 0.05, 1.5), flat=rng.random() < 0.7)
            return {**target, "velocity": [velocity[0], velocity[1], abs(velocity[2])]}, {}, None
        case "obstacle":
            return _obstacle(rng)
        case "slip":
            return {"friction": _between(rng, 0.001, 0.15), **_lasting(rng, 0.1, 12)}, {}, None
        case "appear":
            item = rng.choice(_kinds(cell)) if _kinds(cell) else "block"
            place = [round(rng.uniform(0.36, 0.66), 3), round(rng.uniform(-0.28, 0.28), 3)]
            colour = rng.choice(COLOURS)
            return {"kind": item, "colour": colour, "place": place}, {"item": f"{colour} {item}"}, None
        case "heavier":
            mass = _between(rng, 0.2, 7.0)
            return {**target, "mass": f"{mass} kg"}, {}, mass
        case "larger":
            return {**target, "factor": _between(rng, 1.08, 1.9)}, {}, None
        case "gripper_jam":
            return _lasting(rng, 0.5, 12), {}, None
        case "gripper_weak":
            return {"share": _between(rng, 0.01, 0.7), **_lasting(rng, 1, 15)}, {}, None
        case "camera_drop":
            if rng.random() < 0.4:
                return {"images": rng.randint(1, 5)}, camera, None
            return _lasting(rng, 0.3, 10), camera, None
        case "camera_shift":
            shift = _between(rng, 0.003, 0.08)
            turn = [round(rng.uniform(-3, 3), 2) if rng.random() < 0.3 else 0 for _ in range(3)]
            entry = {"shift": _vector(rng, shift, flat=True), "turn": [f"{each} deg" for each in turn]}
            return {**entry, **_lasting(rng, 1, 20)}, camera, None if any(turn) else shift
        case "camera_noise":
            return {"factor": _between(rng, 2, 35, 1), **_lasting(rng, 1, 20)}, camera, None
        case "camera_mislabel":
            one, other = rng.sample(COLOURS, 2)
            entry = {"colour": one, "shown_as": other, "swapped": rng.random() < 0.3, **_lasting(rng, 1, 20)}
            return entry, {"colour": one, "shown_as": other}, None
        case "wrench_bias":
            force = _between(rng, 1.0, 60.0, 1)
            return {"force": _vector(rng, force), **_lasting(rng, 0.5, 20)}, {}, force
        case "joint_weak":
            joint = rng.choice(joints(cell.robot))
            return (
                {"joint": joint, "share": _between(rng, 0.02, 0.8), **_lasting(rng, 0.5, 20)},
                {"joint": joint},
                None,
            )
        case "wrench_dead" | "stall":
            return _lasting(rng, 0.2, 12), {}, None
        case "no_plan":
            return (
                ({"requests": rng.randint(1, 12)} if rng.random() < 0.4 else _lasting(rng, 0.5, 20)),
                {},
                None,
            )
        case _:
            return {}, {}, None


def _obstacle(rng: random.Random) -> tuple[Tree, dict[str, str], None]:
    """Return a body that stands on the table, in the way or not."""
    height = round(rng.uniform(0.05, 0.5), 3)
    at = [round(rng.uniform(0.2, 0.65), 3), round(rng.uniform(-0.45, 0.45), 3), round(height / 2, 4)]
    side = round(rng.uniform(0.02, 0.09), 3)
    form: Tree = {"box": [side, round(rng.uniform(0.02, 0.12), 3), height]}
    if rng.random() < 0.4:
        form = {"cylinder": {"radius": round(side / 2, 4), "height": height}}
    colour = rng.choice(("grey", "grey", "white", *COLOURS))
    name = rng.choice(("post", "tin", "crate", "lamp"))
    entry: Tree = {"body": {**form, "at": at, "colour": colour}, "name": name}
    if rng.random() < 0.5:
        entry["stays"] = f"{_between(rng, 3, 40, 1)} s"
    return entry, {"body": f"{name}|obstacle|unknown|did not know"}, None


def _kinds(cell: Cell) -> list[str]:
    """Return the kinds of the catalogue that the cell's items have."""
    loads = (*cell.scene.get("spawn", ()), *cell.scene.get("feed", ()))
    return sorted({kind for load in loads for kind in load["of"] if kind != "assortment"})


def joints(robot: str) -> tuple[str, ...]:
    """Return the names of an arm's joints."""
    return tuple(load_robot(robot, ROOT).joints)


SCENE_WEIGHTS: Mapping[str, float] = {
    "bin_filled": 6, "way_blocked": 7, "items_hidden": 5, "false_item": 4, "bin_small": 6, "bin_high": 5,
    "bin_far": 5, "lid_on_bin": 4, "camera_error": 8, "tool_error": 5, "depth_noise": 5, "item_far": 6,
    "item_wide": 5, "force_limit": 3, "payload_limit": 3, "board_off": 5,
}  # fmt: skip
"""Kinds of changes of a scene, and the weight of each in a draw."""


def _scene_change(rng: random.Random, cell: Cell) -> Deviation | None:
    kind = rng.choices(tuple(SCENE_WEIGHTS), tuple(SCENE_WEIGHTS.values()))[0]
    base = str(cell.scene["base"])
    colours: list[str] = list(
        (cell.scene.get("spawn") or cell.scene.get("feed") or [{}])[0].get("colours", COLOURS)
    )
    table = base in (*_SCENES, "touching")
    name = f"{rng.choice(colours)}_bin"
    where = _BIN_PLACES.get(name)
    names: dict[str, str] = {"bin": name}

    def change(*operations: Operation, magnitude: float | None = None, **words: str) -> Deviation:
        return Deviation(kind, "scene", operations=operations, names={**names, **words}, magnitude=magnitude)

    def unknown(body: Tree, called: str) -> Operation:
        return Operation("set", ("unknown", called), body)

    if kind.startswith("bin_") or kind == "lid_on_bin":
        if not table or where is None:
            return None
        x, y = where
        match kind:
            case "bin_filled":
                height = round(rng.uniform(0.03, 0.16), 3)
                size = [round(rng.uniform(0.1, 0.23), 3), round(rng.uniform(0.08, 0.18), 3), height]
                body = {"box": size, "at": [x, y, round(0.006 + height / 2, 4)]}
                return change(unknown(body, "load"), body="load|unknown|obstacle|did not know")
            case "bin_small":
                size = [
                    round(rng.uniform(0.06, 0.14), 3),
                    round(rng.uniform(0.06, 0.14), 3),
                    round(rng.uniform(0.02, 0.1), 3),
                ]
                return change(Operation("set", ("fixtures", name, "bin"), size))
            case "bin_high":
                return change(
                    Operation("set", ("fixtures", name, "at"), [x, y, round(rng.uniform(0.08, 0.6), 3)])
                )
            case "bin_far":
                far = rng.uniform(0.7, 1.3) if rng.random() < 0.5 else rng.uniform(-0.6, -0.2)
                return change(Operation("set", ("fixtures", name, "at"), [round(far, 3), y, 0]))
            case _:
                lid = {"box": [0.3, 0.3, 0.02], "at": [x, y, round(rng.uniform(0.12, 0.35), 3)]}
                return change(Operation("set", ("fixtures", "lid"), lid), body="lid")
    match kind:
        case "way_blocked":
            height = round(rng.uniform(0.12, 0.6), 3)
            at = [
                round(rng.uniform(0.25, 0.6), 3),
                round(rng.choice((-1, 1)) * rng.uniform(0.27, 0.36), 3),
                round(height / 2, 4),
            ]
            body = {"box": [round(rng.uniform(0.03, 0.4), 3), 0.03, height], "at": at}
            return change(unknown(body, "wall"), body="wall|unknown|obstacle|did not know")
        case "items_hidden":
            if base in ("belt", "tote", "totes", "pile"):
                return None
            at = [
                round(rng.uniform(0.42, 0.58), 3),
                round(rng.uniform(-0.15, 0.15), 3),
                round(rng.uniform(0.25, 0.5), 3),
            ]
            side = round(rng.uniform(0.08, 0.25), 3)
            return change(
                unknown({"box": [side, side, 0.02], "at": at}, "shade"), body="shade|unknown|obstacle"
            )
        case "false_item":
            if not table:
                return None
            side = round(rng.uniform(0.03, 0.05), 3)
            at = [
                round(rng.uniform(0.38, 0.62), 3),
                round(rng.choice((-1, 1)) * rng.uniform(0.27, 0.33), 3),
                round(side / 2, 4),
            ]
            return change(
                unknown({"box": [side, side, side], "at": at, "colour": rng.choice(colours)}, "lump")
            )
        case "camera_error":
            off = _between(rng, 0.004, 0.07)
            return change(Operation("set", ("cameras", "overhead", "error"), _vector(rng, off, flat=True)),
                          magnitude=off, camera="camera|overhead")  # fmt: skip
        case "tool_error":
            return change(Operation("set", ("tool_error",), _vector(rng, _between(rng, 0.002, 0.03))))
        case "depth_noise":
            noise = f"{_between(rng, 4, 60, 1)} mm"
            return change(
                Operation("set", ("cameras", "overhead", "depth_noise"), noise), camera="camera|overhead"
            )
        case "item_far" if table:
            item, colour = rng.choice(_SCENES.get(base, ("block",))), rng.choice(colours)
            spawn = {"of": {item: 1}, "colours": [colour], "area": {"min": [0.84, -0.1], "max": [0.94, 0.1]}}
            return change(Operation("insert", ("spawn", 9), spawn), item=f"{colour} {item}")
        case "item_wide" if table:
            side, colour = rng.randint(85, 130), rng.choice(colours)
            spawn = {
                "of": {"chest": 1},
                "colours": [colour],
                "area": {"min": [0.4, -0.2], "max": [0.6, 0.2]},
                "gap": "20 mm",
            }
            box = [f"{side} mm", f"{side + 10} mm", "60 mm"]
            entry = {"box": box, "mass": "200 g", "friction": 0.6}
            added = Operation("insert", ("spawn", 9), spawn)
            return change(Operation("set", ("catalogue", "chest"), entry), added, item=f"{colour} chest")
        case "force_limit":
            return change(Operation("set", ("limits", "force"), f"{rng.randint(4, 30)} N"))
        case "payload_limit":
            return change(Operation("set", ("limits", "payload"), f"{rng.randint(20, 200)} g"))
        case "board_off" if base in ("pegs", "kit"):
            board = "board" if base == "pegs" else "tray"
            off = {"position": f"{rng.randint(8, 30)} mm", "angle": f"{rng.randint(1, 8)} deg"}
            return change(Operation("set", ("fixtures", board, "uncertainty"), off), body=board)
        case _:
            return None


_BIN_PLACES = {"red_bin": (0.42, 0.48), "green_bin": (0.12, 0.48), "blue_bin": (0.42, -0.48)}
"""Middles of the bins of the shipped scene `three_bins`, x and y in the world, m."""


def nodes(tree: Any, at: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], str, Any]]:
    """Yield the nodes of a mission's trees: place in the YAML tree, ID, ports with children."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            if key[:1].isupper():
                yield (*at, key), key, value
            yield from nodes(value, (*at, key))
    elif isinstance(tree, list):
        for number, value in enumerate(tree):
            if isinstance(value, str) and value[:1].isupper():
                yield (*at, number), value, None
            yield from nodes(value, (*at, number))


def mission_changes(rng: random.Random, cell: Cell) -> Iterator[Deviation]:
    """Yield a change of the mission for each place where one is possible."""
    mission = cell.mission
    found = [each for each in nodes(mission["trees"], ("trees",)) if len(each[0]) > 2]

    def change(kind: str, *operations: Operation, magnitude: float | None = None, **names: str) -> Deviation:
        return Deviation(kind, "mission", operations=operations, names=names, magnitude=magnitude)

    item_list = sum(sum(load["of"].values()) for load in cell.scene.get("spawn", ()))
    yield change("goal_beyond", Operation("set", ("goal",), f"sorted >= {item_list + rng.randint(1, 4)}"))
    for at, name, ports in found:
        held = ports if isinstance(ports, dict) else {}
        in_list = len(at) > 1 and isinstance(at[-2], int)
        if name in ("Observe", "LookTwice", "LookPatiently") and in_list:
            yield change("look_left_out", Operation("delete", at[:-1]))
        if name == "Place" and "into" in held:
            bin_ = rng.choice(BINS)
            yield change("wrong_bin", Operation("set", (*at, "into"), bin_), bin=bin_)
            place = [round(rng.uniform(0.3, 0.6), 2), round(rng.uniform(-0.2, 0.2), 2), 0.0]
            yield change(
                "put_elsewhere", Operation("delete", (*at, "into")), Operation("set", (*at, "at"), place)
            )
        if name == "Grasp" and "force" not in held and held:
            force = _between(rng, 0.2, 6.0, 2)
            yield change("weak_grip", Operation("set", (*at, "force"), f"{force} N"), magnitude=force)
        if name == "ForEach":
            yield from _loop_changes(rng, at, held, change)
        if name == "Recover":
            for key in held.get("when", {}):
                yield change("handler", Operation("delete", (*at, "when", key)))
            if isinstance(held.get("attempts"), int) and held["attempts"] > 1:
                yield change("attempts", Operation("set", (*at, "attempts"), 1))
        if name == "Repeat" and "num_cycles" in held:
            yield change("attempts", Operation("set", (*at, "num_cycles"), 1))
            steps = held.get("do", {}).get("Sequence") if isinstance(held.get("do"), dict) else None
            if isinstance(steps, list) and isinstance(steps[0], dict) and "Observe" in steps[0]:
                later = {"Repeat": {**held, "do": {"Sequence": steps[1:]}}}
                yield change(
                    "stale_list",
                    Operation("set", at[:-1], _beside(mission, at, {"Sequence": [steps[0], later]})),
                )
        for place, steps in (((*at,), ports), ((*at, "do"), held.get("do"))):
            for number in range(len(steps) - 1 if isinstance(steps, list) and name != "Fallback" else 0):
                yield change("order", Operation("swap", (*place, number)))
        if name == "Sequence" and isinstance(ports, list):
            condition = {
                "Condition": {"if": rng.choice(("time > 1000", "items_done > 40", "len(items) > 9"))}
            }
            yield change("false_condition", Operation("insert", (*at, min(1, len(ports))), condition))
            delay = {"Delay": {"delay_msec": f"{rng.randint(60, 100)} s", "do": "AlwaysSuccess"}}
            yield change("delay", Operation("insert", (*at, len(ports)), delay), node="Delay")


def _beside(mission: Mapping[str, Any], at: tuple[str | int, ...], node: Tree) -> Tree:
    """Return the mapping that holds the node at a place, with another node instead of it."""
    owner: Any = mission
    for key in at[:-1]:
        owner = owner[key]
    return {**{key: value for key, value in owner.items() if key != at[-1]}, **node}


def _loop_changes(
    rng: random.Random, at: tuple[str | int, ...], held: Tree, change: Any
) -> Iterator[Deviation]:
    """Yield the changes of a loop over items."""
    inner = held.get("do")
    names = [str(key) for key in inner if str(key)[:1].isupper()] if isinstance(inner, dict) else []
    node = names[0] if names else "ForEach"
    allowed = f"{_between(rng, 0.8, 8, 1)} s"
    wrapped = {"Timeout": {"msec": allowed, "do": "<old>"}}
    yield change("time_out", Operation("wrap", (*at, "do"), wrapped), node=f"{node}|Timeout|{allowed}")
    yield change(
        "budget",
        Operation(
            "wrap", (*at, "do"), {"Budget": {"tries": 1, "time": f"{rng.randint(2, 15)} s", "do": "<old>"}}
        ),
    )
    yield change("one_only", Operation("set", (*at, "most"), 1))
    variable = str(held.get("out", "")).strip("{}")
    if variable and isinstance(inner, dict) and len(inner) == 1 and isinstance(inner[node], dict):
        condition = f"{variable}.colour == '{rng.choice(COLOURS)}'"
        yield change("skip_if", Operation("set", (*at, "do", node, "_skipIf"), condition))
    if variable:
        yield change(
            "set_aside",
            Operation("set", (*at, "do"), {"SetAside": {"object": f"{{{variable}}}"}}),
            node="SetAside",
        )

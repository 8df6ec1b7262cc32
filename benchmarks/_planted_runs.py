"""What is made to go wrong in the runs of `planted.py`, and which answers count as naming it."""

from __future__ import annotations

from dataclasses import dataclass

MISSION = """
picktree: 1
kind: mission
scene: scene.yaml
trees:
  Main:
    Repeat:
      while: items_left
      num_cycles: 2
      do:
        Sequence:
          - Observe: {camera: overhead, objects: "{items}"}
          - ForEach: {in: "{items}", out: "{item}", on_failure: continue, do: {SortOne: {item: "{item}"}}}
          - Fallback: [{GoTo: {pose: home}}, SafeRetreat]
  SortOne:
    ports: {item: {type: object}}
    Recover:
      attempts: 2
      do:
        Sequence:
          - Grasp: {object: "{item}"}
          - Place: {object: "{item}", into: "{item.destination}"}
      when:
        grasp.*: [SafeRetreat, {Observe: {camera: overhead}}]
        world.*: [SafeRetreat, {Observe: {camera: overhead}}]
      otherwise: [SafeRetreat]
      give_up: [{SafeRetreat: {hand: open}}]
"""
SCENE = "picktree: 1\nkind: scene\nbase: sort_small\n"
PLATE_FIRST = (
    SCENE
    + """spawn:
  - {of: {plate: 1}, colours: [green], area: {min: [0.36, -0.1], max: [0.42, 0.1]}}
  - {of: {block: 1, ball: 1}, colours: [red, blue], area: {min: [0.5, -0.2], max: [0.62, 0.2]}}
"""
)
"""The nearest item is taken first."""
FAULTS = "picktree: 1\nkind: faults\nfaults:\n"

BUDGET = '''
from picktree.trees.ports import In, port
from picktree.trees.skill import ARM, Skill, Steps
from picktree.world.causes import control, planning, safety
from picktree.planning.requests import NamedGoal
from picktree.skill_world.world import World


class Hurry(Skill):
    """Go to a named pose with little thought."""

    pose: In[str] = port("named pose", default="home")
    budget: In[int] = port("collision checks", default=30)
    causes = (planning.ANY, control.ANY, safety.ANY)
    uses = (ARM,)
    example = "Hurry: {pose: home}"

    def run(self, world: World) -> Steps:
        plan = yield from world.plan.to(NamedGoal(self.pose), node=self.path, budget=self.budget)
        yield from world.move.along(plan.trajectory, node=self.path)


NODES = (Hurry,)
'''


HURRIED = """
picktree: 1
kind: mission
scene: scene.yaml
plugins: [hurry.py]
trees:
  Main:
    Sequence:
      - Hurry: {pose: observe}
      - Observe: {camera: overhead}
      - Hurry: {pose: home}
"""


@dataclass(frozen=True)
class Planted:
    """What was made to go wrong, and which answers count as naming it."""

    name: str
    what: str
    causes: tuple[str, ...]
    """Names of root causes."""
    says: tuple[str, ...] = ()
    """Words that the root cause's sentence must hold, all of them."""
    scene: str = SCENE
    mission: str = MISSION
    faults: str = ""
    seed: int = 3
    backend: str = "kinematic"
    limit: float = 300.0
    plugin: str = ""


PLANTED = (
    Planted(
        "taken",
        "the item of the second grasp is snatched away before the fingers close",
        ("item.gone",),
        faults=FAULTS
        + "  - {fault: remove, when: {node: Grasp, start: 2, delay: 500 ms}, target: {nearest_to: object}}\n",
    ),
    Planted(
        "taken_from_the_hand",
        "what the hand holds is snatched away on its way to the bin",
        ("item.gone",),
        says=("hand",),
        faults=FAULTS
        + "  - {fault: remove, when: {node: Place, start: 2, delay: 400 ms}, target: {nearest_to: tool}}\n",
        backend="physics",
    ),
    Planted(
        "taken_from_the_bin",
        "an item is snatched out of its bin after it was placed; nothing fails",
        ("item.gone",),
        says=("bin",),
        scene=PLATE_FIRST,
        faults=FAULTS
        + "  - {fault: remove, when: {node: Grasp, start: 3, delay: 300 ms}, target: {kind: plate}}\n",
    ),
    Planted(
        "pushed",
        "the item of the second grasp is pushed away while the arm is on its way to it",
        ("item.moved",),
        faults=FAULTS
        + "  - {fault: bump, when: {node: Grasp, start: 2, delay: 300 ms}, target: {nearest_to: object},\n"
        "     velocity: [0.9, 0.5, 0]}\n",
    ),
    Planted(
        "flung_out",
        "an item is flung out of its bin after it was placed",
        ("item.left_bin",),
        says=("bin",),
        scene=PLATE_FIRST,
        faults=FAULTS
        + "  - {fault: bump, when: {node: Grasp, start: 3, delay: 300 ms}, target: {kind: plate},\n"
        "     velocity: [0.4, -1.0, 2.2]}\n",
        backend="physics",
    ),
    Planted(
        "slippery",
        "an item is oiled just before it is grasped",
        ("item.slippery",),
        faults=FAULTS + "  - {fault: friction, when: {node: Grasp, start: 2}, target: {nearest_to: object},\n"
        "     friction: 0.01}\n",
        backend="physics",
    ),
    Planted(
        "heavy",
        "an item weighs thirty times as much as the catalogue says",
        ("item.heavy",),
        faults=FAULTS + "  - {fault: friction, when: {node: Grasp, start: 2}, target: {nearest_to: object},\n"
        "     friction: 0.5, mass: 4.0}\n",
        backend="physics",
    ),
    Planted(
        "weak",
        "the mission grips with next to no force",
        ("grasp.weak",),
        mission=MISSION.replace('Grasp: {object: "{item}"}', 'Grasp: {object: "{item}", force: 0.4 N}'),
        backend="physics",
        seed=4,
    ),
    Planted(
        "shelf",
        "a shelf stands between the items: the hand does not fit beside it",
        ("scene.blocked",),
        says=("shelf",),
        scene=SCENE + "fixtures:\n  shelf: {box: [0.02, 0.5, 0.25], at: [0.47, 0.0, 0.125]}\n"
        "spawn:\n  - {of: {ball: 1}, colours: [red], gap: 5 mm,\n"
        "     area: {min: [0.49, -0.1], max: [0.53, 0.1]}}\n"
        "  - {of: {block: 1}, colours: [blue], area: {min: [0.35, -0.1], max: [0.4, 0.1]}}\n",
    ),
    Planted(
        "lid",
        "a lid lies over the red bin",
        ("scene.blocked",),
        says=("lid",),
        scene=SCENE + "fixtures:\n  lid: {box: [0.3, 0.3, 0.02], at: [0.42, 0.48, 0.2]}\n"
        "spawn:\n  - {of: {plate: 1}, colours: [red], gap: 50 mm,\n"
        "     area: {min: [0.4, -0.2], max: [0.6, 0.1]}}\n",
    ),
    Planted(
        "far",
        "the items lie further away than the arm reaches",
        ("item.out_of_reach",),
        scene=SCENE
        + "spawn:\n  - {of: {block: 1}, colours: [red], area: {min: [0.86, -0.1], max: [0.9, 0.1]}}\n"
        "  - {of: {ball: 1}, colours: [blue], area: {min: [0.4, -0.1], max: [0.5, 0.1]}}\n",
    ),
    Planted(
        "small_bin",
        "the bin is too small for all items that belong into it",
        ("bin.full", "bin.crowded"),
        says=("red_bin",),
        scene=SCENE + "fixtures:\n  red_bin: {bin: [0.1, 0.1, 0.03], wall: 5 mm, at: [0.42, 0.48, 0]}\n"
        "spawn:\n  - {of: {block: 4}, colours: [red], gap: 30 mm,\n"
        "     area: {min: [0.36, -0.22], max: [0.64, 0.2]}}\n",
        backend="physics",
    ),
    Planted(
        "camera",
        "the camera hangs 3 cm from where it is believed to hang",
        ("camera.off",),
        says=("overhead",),
        scene=SCENE + "cameras:\n  overhead: {error: [30 mm, 0, 0]}\n",
    ),
    Planted(
        "unseen",
        "an item lies where the camera does not look",
        ("item.never_seen",),
        scene=SCENE
        + "spawn:\n  - {of: {block: 1}, colours: [red], area: {min: [0.4, -0.75], max: [0.5, -0.7]}}\n"
        "  - {of: {ball: 1}, colours: [blue], area: {min: [0.4, -0.1], max: [0.5, 0.1]}}\n",
    ),
    Planted(
        "wrong_bin",
        "the mission takes every item into the red bin",
        ("mission.wrong_bin",),
        says=("red_bin",),
        mission=MISSION.replace('into: "{item.destination}"', "into: red_bin"),
    ),
    Planted(
        "hurry",
        "the planner has a budget of thirty checks for a way round a wall",
        ("planner.budget",),
        scene=SCENE + "fixtures:\n  wall: {box: [0.3, 0.02, 0.9], at: [0.5, 0.25, 0.45]}\n",
        mission=HURRIED,
        plugin=BUDGET,
    ),
    Planted(
        "timeout",
        "sorting an item may take two seconds, and takes four",
        ("tree.timeout",),
        mission=MISSION.replace(
            'do: {SortOne: {item: "{item}"}}',
            'do: {Timeout: {msec: 2 s, do: {SortOne: {item: "{item}"}}}}',
        ),
    ),
    Planted(
        "limit",
        "the run is ended after ten simulated seconds",
        ("run.limit",),
        limit=10.0,
    ),
)

"""Taking stock: the robot wakes up with an older belief, and looks before it goes on with anything.

What is in the hand is felt and put down, the arm gets clear and goes home, all cameras look, and what was
done meanwhile is told from what is seen.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ..manipulation.carry.hold_check import GripCheck
from ..manipulation.grasp.straight_lines import DOWN
from ..trees.loading.loader import parse_mission
from ..trees.loading.registry import NodeRegistry
from ..trees.running.builder import build
from ..trees.status import NodeStatus
from ..world.belief.planning_scene import BeliefObject
from ..world.causes import Failure
from ..world.journal import JournalEvent, Plain
from ..world.scene.destinations import is_at
from ..world.shapes import Box
from ..world.values import ObjectId, Pose

if TYPE_CHECKING:
    from ..cell.world import World

PROBE: Final = 0.004
"""By how much the fingers try to close, m: where nothing is between them they do."""
YIELDS: Final = 0.5
"""Share of it from which they count as closing."""
GENTLY: Final = 5.0
"""Force a finger with which they try, N, unless they press more firmly already."""
SPAN: Final = 0.10
"""Of what is in the hand, along the pads and downwards: nobody knows what it is, m."""
TRIES: Final = 2
"""How often the hand is emptied: the second time where it is."""
UNKNOWN: Final = ObjectId("in_hand")
LOWERED: Final = 0.15
"""How far down what weighs next to nothing is let, m: until it touches."""
TOUCH, SLOWLY = 5.0, 0.05
"""Force that says that it does, N, and the speed, m/s."""
_HEAD: Final = "picktree: 1\nkind: mission\nname: taking stock\ntrees:\n  Main:\n    "
_HOME: Final = f"{_HEAD}SafeRetreat\n"
_LET_GO: Final = f"{_HEAD}SafeRetreat: {{hand: open}}\n"
_PUT_DOWN: Final = f"""\
{_HEAD}Sequence:
      - SafeRetreat: {{hand: keep}}          # what is put down below home is in view of the cameras
      - SafeRetreat: {{hand: put_down}}
"""


@dataclass(frozen=True, slots=True)
class ResyncReport:
    """What was found: ids of items as the belief knows them."""

    done: tuple[ObjectId, ...]
    """To be done by the older belief, and seen where they belong now."""
    gone: tuple[ObjectId, ...]
    """To be done by the older belief, and no longer seen anywhere."""
    held: bool
    """Something was in the hand."""


def resync_belief(world: World) -> Generator[None, None, ResyncReport]:
    """Each yield is one tick. It never fails: what it cannot do it says, and leaves to the mission."""
    _note(world, "the run goes on as things stand: it looks first, with the belief of before", {})
    try:
        yield from world.move.rest()
    except Failure as failure:
        _note(world, f"the arm does not come to rest: {failure.message}", {"failed": str(failure.cause)})
    known = {o.id: o for o in world.scene.objects if o.role == "item"}
    to_do = [o.id for o in world.to_do()]
    attempts = world.attempts.state()
    held = False
    for attempt in range(TRIES):
        hold = yield from _feel(world)
        if hold is None:
            break
        held = True
        carried = hold.loaded and attempt == 0
        if not carried:
            yield from _lower(world)
        yield from _carry_out(_PUT_DOWN if carried else _LET_GO, world)
        if world.scene.find(UNKNOWN) is not None:
            # The cameras tell what it is, under the name that it had.
            world.scene.remove(UNKNOWN, "it is looked what it was")
    if not held:
        yield from _carry_out(_HOME, world)
    yield from _look(world)
    _recognise(world, known)
    world.attempts.restore(attempts)
    return _told(world, to_do, held)


def _feel(world: World) -> Generator[None, None, GripCheck | None]:
    """What is in the hand, which is then believed there as something unknown; None: nothing."""
    yield from world.control.settle()
    grip = world.grip.state
    hold = GripCheck(grip.width, world.control.load())
    if hold.empty:
        return None
    # Nobody knows what the fingers were told last. Less force than now might drop what they hold.
    least = max(grip.width - PROBE, 0.0)
    reached = yield from world.grip.move(least, max(abs(grip.force), GENTLY))
    if reached < grip.width - YIELDS * (grip.width - least):
        return None
    said = "is in the hand" if hold.loaded else "is between the fingers, and weighs next to nothing"
    _note(world, f"something {said}: {hold}", {"width": hold.width, "load": hold.load, "held": True})
    shape = Box((SPAN, max(grip.width, 0.005), SPAN))
    tcp = world.control.tcp
    believed = BeliefObject(
        UNKNOWN, "item", "unknown", "unknown", shape, "unknown", tcp, 0.02, 0.2, 0.5, world.clock.now
    )
    world.scene.put(believed, "felt in the hand")
    world.scene.attach(UNKNOWN, Pose())
    return hold


def _lower(world: World) -> Generator[None, None, None]:
    """Down until it touches: it may stand on something already."""
    try:
        yield from world.move.guarded(DOWN, LOWERED, TOUCH, SLOWLY)
    except Failure as failure:
        _note(world, f"it is not let down any further: {failure.message}", {"failed": str(failure.cause)})


def _carry_out(text: str, world: World) -> Generator[None, None, None]:
    """A tree of its own, so that the mission's is not touched."""
    tree = build(parse_mission(text, Path("taking_stock.yaml"), NodeRegistry()), world, {})
    tree.step()
    while tree.status is NodeStatus.RUNNING:
        yield
        tree.step()
    if tree.failure is not None:
        message = f"the arm does not get home: {tree.failure.message}"
        _note(world, message, {"failed": str(tree.failure.cause)})


def _look(world: World) -> Generator[None, None, None]:
    for camera in world.description.cameras:
        try:
            yield from world.eyes.look(camera.name)
        except Failure as failure:
            _note(world, f"{camera.name} shows nothing: {failure.message}", {"camera": camera.name})


def _recognise(world: World, known: Mapping[ObjectId, BeliefObject]) -> None:
    """What is no longer where it was known to be, and is seen elsewhere for the first time, is the same: of
    its kind and colour the nearest. While it was in the hand nobody saw it anywhere."""
    new = [o for o in world.scene.objects if o.role == "item" and o.id not in known]
    lost = [o for o in known.values() if world.scene.find(o.id) is None]
    pairs = [
        (old.pose.distance(now.pose), old, now)
        for old in lost
        for now in new
        if (old.kind, old.colour) == (now.kind, now.colour)
    ]
    for _, old, now in sorted(pairs, key=lambda pair: (pair[0], pair[1].id, pair[2].id)):
        if world.scene.find(old.id) is None and world.scene.find(now.id) is not None:
            world.scene.remove(now.id, f"it is {old.id}")
            world.scene.put(replace(now, id=old.id), "known from before, and seen elsewhere")


def _told(world: World, to_do: Sequence[ObjectId], held: bool) -> ResyncReport:
    """Count what was done meanwhile, and say what nobody can know."""
    done: list[ObjectId] = []
    gone: list[ObjectId] = []
    for name in to_do:
        now = world.scene.find(name)
        if now is None:
            gone.append(name)
        elif (to := world.scene.destination(name)) is not None and is_at(now.place, to):
            done.append(name)
    world.journal.items_done += len(done)
    parts = [f"{', '.join(done)} is done"] if done else ["nothing more is done"]
    if gone:
        parts.append(f"{', '.join(gone)} is seen nowhere, and not counted as done")
    data: dict[str, Plain] = {
        "done": [str(name) for name in done],
        "gone": [str(name) for name in gone],
        "items_done": world.journal.items_done,
    }
    _note(world, f"looked: {'; '.join(parts)}; {len(world.to_do())} to be done", data)
    return ResyncReport(tuple(done), tuple(gone), held)


def _note(world: World, message: str, data: dict[str, Plain]) -> None:
    world.journal.note(JournalEvent("took_stock", message, "", data))

"""Taking stock: the robot wakes up with an older belief, and looks before it goes on with anything.

What is in the hand is felt and put down, the arm gets clear and goes home, all cameras look, and what was
done meanwhile is told from what is seen.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ..trees.builder import build
from ..trees.loader import parse_mission
from ..trees.registry import Registry
from ..trees.status import NodeStatus
from ..world.causes import Failure
from ..world.journal import Happened, Plain
from ..world.manipulation.holding import Hold
from ..world.scene.destinations import is_at
from ..world.scene.planning_scene import BeliefObject
from ..world.shapes import Box
from ..world.values import ObjectId, Pose

if TYPE_CHECKING:
    from ..world.world import World

PROBE: Final = 0.004
"""By how much the fingers try to close, m: where nothing is between them they do."""
YIELDS: Final = 0.5
"""Share of it from which they count as closing."""
GENTLY: Final = 5.0
"""Force a finger with which they try, N, unless they press more firmly already."""
SPAN: Final = 0.10
"""Of what is in the hand, along the pads and downwards: nobody knows what it is, m."""
LATELY: Final = 10.0
"""What was seen within this time was seen when it was looked, s."""
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
class Stock:
    """What was found: ids of items as the belief knows them."""

    done: tuple[ObjectId, ...]
    """To be done by the older belief, and seen where they belong now."""
    gone: tuple[ObjectId, ...]
    """To be done by the older belief, and no longer seen anywhere."""
    held: bool
    """Something was in the hand."""


def take_stock(world: World) -> Generator[None, None, Stock]:
    """Each yield is one tick. It never fails: what it cannot do it says, and leaves to the mission."""
    _note(world, "the run goes on as things stand: it looks first, with the belief of before", {})
    yield from world.move.rest()
    yield from world.control.settle()
    before = {o.id: o for o in world.to_do()}
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
    return _told(world, before, held)


def _feel(world: World) -> Generator[None, None, Hold | None]:
    """What is in the hand, which is then believed there as something unknown; None: nothing."""
    yield from world.control.settle()
    grip = world.grip.state
    hold = Hold(grip.width, world.control.load())
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
        yield from world.move.guarded((0.0, 0.0, -1.0), LOWERED, TOUCH, SLOWLY)
    except Failure as failure:
        _note(world, f"it is not let down any further: {failure.message}", {"failed": str(failure.cause)})


def _carry_out(text: str, world: World) -> Generator[None, None, None]:
    """A tree of its own, so that the mission's is not touched."""
    tree = build(parse_mission(text, Path("taking_stock.yaml"), Registry()), world, {})
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
            summary = yield from world.eyes.look(camera.name)
        except Failure as failure:
            _note(world, f"{camera.name} shows nothing: {failure.message}", {"camera": camera.name})
            continue
        for name in summary.removed:
            world.attempts.forget(name)


def _told(world: World, before: dict[ObjectId, BeliefObject], held: bool) -> Stock:
    """Count what was done meanwhile, and say what nobody can know."""
    done: list[ObjectId] = []
    gone: list[ObjectId] = []
    for name in before:
        now = world.scene.find(name)
        if now is None:
            gone.append(name)
        elif (to := world.scene.destination(name)) is not None and is_at(now.place, to):
            done.append(name)
    news = [
        o
        for o in world.scene.objects
        if o.id not in before and o.role == "item" and o.last_seen >= world.clock.now - LATELY
    ]
    # What left its place and is seen anew where it belongs is one and the same, as far as anybody can tell.
    arrived = [o for o in news if (to := world.scene.destination(o.id)) is not None and is_at(o.place, to)]
    for belief in arrived:
        same = next((name for name in gone if _alike(before[name], belief)), None)
        if same is not None:
            gone.remove(same)
            done.append(same)
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
    return Stock(tuple(done), tuple(gone), held)


def _alike(one: BeliefObject, other: BeliefObject) -> bool:
    return (one.kind, one.colour) == (other.kind, other.colour)


def _note(world: World, message: str, data: dict[str, Plain]) -> None:
    world.journal.note(Happened("took_stock", message, "", data))

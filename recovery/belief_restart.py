"""Resynchronisation of an older belief with the scene at the restart of a run, and the last look at its end.

At a restart the hand's content is measured and put down, the arm retreats and moves home, and all cameras
look. The images then show which items were sorted in the time between.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from picktree.robot.manipulation import DOWNWARDS, held_object
from picktree.trees import NodeStatus, build
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import BeliefObject, Box, Failure, ObjectId, Pose, event_types
from picktree.world.scene import destinations

if TYPE_CHECKING:
    from picktree.robot import World

PROBE_DISTANCE: Final = 0.004
"""Distance by which the fingers try to close, m: they do when nothing is between them."""
MIN_PROBE_SHARE: Final = 0.5
"""Share of PROBE_DISTANCE from which the fingers count as closing."""
MIN_PROBE_FORCE: Final = 5.0
"""Least force of each finger during the probe, N; a higher force already set is kept."""
UNKNOWN_OBJECT_SIZE: Final = 0.10
"""Assumed size of the unknown object in the hand, along the pads and downwards, m."""
MAX_EMPTYING_ATTEMPTS: Final = 2
"""Maximum number of attempts to empty the hand."""
MAX_HOME_DISTANCE: Final = 0.02
"""Greatest distance of a joint to its position at home, at which the arm is there, rad."""
UNKNOWN_OBJECT: Final = ObjectId("in_hand")
MAX_DESCENT: Final = 0.15
"""Maximum descent of an object that weighs next to nothing, m; contact ends it."""
CONTACT_FORCE, DESCENT_SPEED = 5.0, 0.05
"""Contact force that ends the descent, N, and its speed, m/s."""
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
    """Result of a resynchronisation: ids of items in the belief."""

    done: tuple[ObjectId, ...]
    """Items that were to do in the older belief, and are seen at their destination."""
    gone: tuple[ObjectId, ...]
    """Items that were to do in the older belief, and are no longer seen anywhere."""
    held: bool
    """Whether an object was in the hand."""


def resync_belief(world: World) -> Generator[None, None, ResyncReport]:
    """Resynchronise the belief; the arm moves, and each yield is one tick.

    It never fails: steps that are impossible are recorded and left to the mission.
    """
    world.journal.note(
        event_types.TookStockEvent(
            "the run goes on as things stand: it looks first, with the belief of before"
        )
    )
    try:
        yield from world.move.rest()
    except Failure as failure:
        world.journal.note(
            event_types.TookStockEvent(
                f"the arm does not come to rest: {failure.message}", failed=str(failure.cause)
            )
        )
    known = {o.id: o for o in world.scene.objects if o.role == "item"}
    to_do = [o.id for o in world.to_do()]
    attempts = world.attempts.state()
    held = False
    for attempt in range(MAX_EMPTYING_ATTEMPTS):
        hold = yield from _measure_hand(world)
        if hold is None:
            break
        held = True
        carried = hold.loaded and attempt == 0
        if not carried:
            yield from _lower(world)
        yield from _carry_out(_PUT_DOWN if carried else _LET_GO, world)
        if world.scene.find(UNKNOWN_OBJECT) is not None:
            # The cameras identify the object, under its former name.
            world.scene.remove(UNKNOWN_OBJECT, "it is looked what it was")
    if not held:
        yield from _carry_out(_HOME, world)
    yield from _look(world, [camera.name for camera in world.description.cameras])
    _recognise(world, known)
    world.attempts.restore(attempts)
    return _resync_report(world, to_do, held)


def last_look(world: World) -> Generator[None, None, None]:
    """Look with the fixed cameras at the end of a run, and recognise everything anew; each yield is one tick.

    The arm moves home before, out of their view; after a latched safety stop it stays where it is. It never
    fails: what no camera sees is believed as before.
    """
    if world.control.monitor.stopped is None and not _is_home(world):
        yield from _carry_out(_HOME, world)
    cameras = [camera.name for camera in world.description.cameras if camera.on == "world"]
    yield from _look(world, cameras, fresh=True)


def _is_home(world: World) -> bool:
    """Return whether the arm rests at home."""
    off = np.abs(world.control.state.position - world.robot.named("home")).max()
    return world.control.at_rest and float(off) < MAX_HOME_DISTANCE


def _measure_hand(world: World) -> Generator[None, None, held_object.GripCheck | None]:
    """Measure the content of the hand, and believe it there as an unknown object; None: the hand is empty."""
    yield from world.control.settle()
    grip = world.gripper.state
    hold = held_object.GripCheck(grip.width, world.control.load())
    if hold.empty:
        return None
    # The last force command is unknown. Less force than the present might drop a held object.
    least = max(grip.width - PROBE_DISTANCE, 0.0)
    reached = yield from world.gripper.move(least, max(abs(grip.force), MIN_PROBE_FORCE))
    if reached < grip.width - MIN_PROBE_SHARE * (grip.width - least):
        return None
    state = "is in the hand" if hold.loaded else "is between the fingers, and weighs next to nothing"
    world.journal.note(
        event_types.TookStockEvent(f"something {state}: {hold}", width=hold.width, load=hold.load, held=True)
    )
    shape = Box((UNKNOWN_OBJECT_SIZE, max(grip.width, 0.005), UNKNOWN_OBJECT_SIZE))
    tcp = world.control.tcp
    believed = BeliefObject(
        "unknown", "unknown", shape, "unknown", tcp, 0.02, 0.2, 0.5, world.clock.now, id=UNKNOWN_OBJECT
    )
    world.scene.put(believed, "felt in the hand")
    world.scene.attach(UNKNOWN_OBJECT, Pose())
    return hold


def _lower(world: World) -> Generator[None, None, None]:
    """Move the arm down until contact; the object may touch its support already."""
    try:
        yield from world.move.guarded(DOWNWARDS, MAX_DESCENT, CONTACT_FORCE, DESCENT_SPEED)
    except Failure as failure:
        world.journal.note(
            event_types.TookStockEvent(
                f"it is not let down any further: {failure.message}", failed=str(failure.cause)
            )
        )


def _carry_out(text: str, world: World) -> Generator[None, None, None]:
    """Run a separate tree, so that the mission's tree stays unchanged."""
    tree = build(parse_mission(text, Path("taking_stock.yaml"), NodeRegistry()), world, {})
    tree.step()
    while tree.status is NodeStatus.RUNNING:
        yield
        tree.step()
    if tree.failure is not None:
        message = f"the arm does not get home: {tree.failure.message}"
        world.journal.note(event_types.TookStockEvent(message, failed=str(tree.failure.cause)))


def _look(world: World, cameras: Sequence[str], *, fresh: bool = False) -> Generator[None, None, None]:
    for camera in cameras:
        try:
            yield from world.vision.observe(camera, fresh=fresh)
        except Failure as failure:
            world.journal.note(
                event_types.TookStockEvent(f"{camera} shows nothing: {failure.message}", camera=camera)
            )


def _recognise(world: World, known: Mapping[ObjectId, BeliefObject]) -> None:
    """Give newly seen items the ids of items that have gone missing, by kind, colour and least distance.

    An item in the hand was visible to no camera before.
    """
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


def _resync_report(world: World, to_do: Sequence[ObjectId], held: bool) -> ResyncReport:
    """Count the items sorted in the time between, and record the uncertain ones."""
    done: list[ObjectId] = []
    gone: list[ObjectId] = []
    for name in to_do:
        now = world.scene.find(name)
        if now is None:
            gone.append(name)
        elif (to := world.scene.destination(name)) is not None and destinations.is_at(now.place, to):
            done.append(name)
    world.journal.items_done += len(done)
    parts = [f"{', '.join(done)} is done"] if done else ["nothing more is done"]
    if gone:
        parts.append(f"{', '.join(gone)} is seen nowhere, and not counted as done")
    message = f"looked: {'; '.join(parts)}; {len(world.to_do())} to be done"
    done_now = world.journal.items_done
    world.journal.note(
        event_types.TookStockEvent(message, done=tuple(done), gone=tuple(gone), items_done=done_now)
    )
    return ResyncReport(tuple(done), tuple(gone), held)

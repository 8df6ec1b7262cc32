"""Ground truth of a log, for the analyst only: true bodies, device states, the scorer's verdicts.

This is the only module of the room that imports the simulation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from picktree.logs import Stamped, log_records, topics
from picktree.logs.recording import fold_states, read_state
from picktree.simulation import MAX_REST_SPEED, ItemScore, TrueBody, score
from picktree.world import ObjectId, Pose, event_types

from .body_tracks import BodyTracks, DeviceState
from .explanation import ItemVerdict

if TYPE_CHECKING:
    from picktree.logs import RunLog

    from .case import Investigation


class TrueWorld:
    """Bodies and devices as they truly were, several times a second."""

    is_true = True
    names = None

    def __init__(self, case: Investigation) -> None:
        log = case.run.log
        devices: list[DeviceState] = []

        def states() -> Iterator[tuple[float, Mapping[str, Any]]]:  # a long log has too many to keep
            for time, state in true_states(log):
                devices.append(device_state(time, state))
                yield time, state

        scenes = true_scenes(list(log.truths()), states())
        self.devices: tuple[DeviceState, ...] = tuple(devices)
        """True states of robot and items; empty for an older log."""
        self.items = BodyTracks(scenes, "item")
        """True tracks of the items, without obstacles."""
        self.obstacles = BodyTracks(scenes, "obstacle")
        """True tracks of the obstacles that the robot did not know."""
        self.sampled = self.items.spacing if devices else 1.05
        """Maximum interval between two samples, s."""

    def gone(self, item: str) -> tuple[float, float] | None:
        return self.items.gone(item)

    def verdicts(self, case: Investigation) -> Mapping[str, ItemVerdict]:
        """Return the scorer's verdict on each item at the end; empty when the scene is not known."""
        if case.scene is None:
            return {}
        scores = score([_true_body(case, id_) for id_ in self.items.tracks], case.scene).items
        moving = self._moving(case, scores)
        crushed = {at.record.object for at in case.events(event_types.CrushedEvent)}
        return {
            (name := str(each.id)): _verdict(
                each,
                moving=name in moving,
                crushed=name in crushed,
                there=case.gone(name) is None,
            )
            for each in scores
        }

    def _moving(self, case: Investigation, scores: Sequence[ItemScore]) -> set[str]:
        """Return the items in their bins that the scorer did not count as sorted because they still moved.

        The log has no velocities. So these are the fastest items just before the end, as many as the result
        counts fewer.
        """
        result, tracks = case.run.result, self.items.tracks
        lying = [each for each in scores if each.verdict == "sorted"]
        number = 0 if result is None else max(0, len(lying) - result.items.sorted)
        fast = sorted(lying, key=lambda each: -tracks[str(each.id)].last_speed)[:number]
        return {str(each.id) for each in fast if tracks[str(each.id)].last_speed > MAX_REST_SPEED}


def _true_body(case: Investigation, id_: str) -> TrueBody:
    last, entry = case.bodies.tracks[id_].last, case.entry_of(id_)
    pressed = (at.record.force for at in case.events(event_types.CrushedEvent) if at.record.object == id_)
    thing = last if isinstance(last, log_records.ThingRecord) else None
    return TrueBody(
        last.kind,
        entry.form if entry else "box",
        last.shape,
        last.colour,
        last.pose,
        id=ObjectId(id_),
        present=case.gone(id_) is None,
        seat=last.seat,
        crushed=max(pressed, default=0.0),
        mass=thing.mass if thing else entry.mass if entry else None,
        tag=thing.tag if thing else None,
    )


def _verdict(found: ItemScore, *, moving: bool, crushed: bool, there: bool) -> ItemVerdict:
    """Return the verdict; an item that moves, or was taken out of its hole, is left."""
    left = moving or (found.verdict == "sorted" and not there)
    return ItemVerdict(
        str(found.destination or ""),
        "" if left else str(found.bin or ""),
        "crushed" if crushed else "left" if left else found.verdict,
        None if found.seat is None else found.seat.depth,
        found.reason,
        moving,
    )


def true_states(log: RunLog) -> Iterator[tuple[float, Mapping[str, Any]]]:
    """Yield the simulation's states in the log, several a second; none for an older log."""
    state: dict[str, Any] | None = None
    for message in log.messages([topics.STATE.name]):
        change = read_state(message.data)
        if state is None and not change.whole:
            continue
        messages = [change] if state is None or change.whole else [log_records.TrueState(True, state), change]
        state = fold_states(messages)
        if state is not None:
            yield message.time / 1e9, state


def true_scenes(
    scenes: Sequence[Stamped[log_records.Scene]], states: Iterable[tuple[float, Mapping[str, Any]]]
) -> list[Stamped[log_records.Scene]]:
    """Return the ground truth at every sample of the log: looks once a second, places with each state."""
    found = list(scenes)
    looks = BodyTracks(scenes)
    known = {at.time for at in scenes}
    for time, state in states:
        if time in known:
            continue
        placed: list[log_records.BodyRecord] = [b for _, b in looks.there(time) if b.role != "item"]
        for item in state["items"]:
            track = looks.tracks.get(str(item["id"]))
            look = None if track is None else track.before(time) or track.first
            if look is not None and item["present"]:
                placed.append(replace(look, pose=_pose(item)))
        found.append(Stamped(time, log_records.Scene(tuple(placed), ())))
    return sorted(found, key=lambda at: at.time)


def _pose(item: Mapping[str, Any]) -> Pose:
    pose: Mapping[str, Any] = item.get("pose", item)
    return Pose(tuple(pose["position"]), tuple(pose["orientation"]))


def device_state(time: float, state: Mapping[str, Any]) -> DeviceState:
    """Return the part of a state that the explanation uses, without knowledge of injected faults."""
    changes = [*state.get("ledger", ()), *({"item": i["id"], **i} for i in state["items"] if "mass" in i)]
    return DeviceState(
        time=time,
        masses={str(c["item"]): c["mass"] for c in changes if c.get("mass") is not None},
        frictions={str(c["item"]): c["friction"] for c in changes if c.get("friction") is not None},
        motions={
            str(i["id"]): (tuple(i["velocity"]), tuple(i["spin"])) for i in state["items"] if "velocity" in i
        },
    )

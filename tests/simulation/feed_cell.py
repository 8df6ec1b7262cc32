"""A cell to which items are brought, in either backend, for the tests of feeds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

import numpy as np

from picktree.simulation import Backend
from picktree.simulation.checkpoints import Checkpoint, KinematicState
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Vector3
from picktree.world.scene import Delivery, SceneDescription, Spawn, WhenClear
from picktree.world.scene.description import Exchange, When

from .simulated_cell import cell, panda

Hardware = PhysicsHardware | KinematicHardware

ASIDE = ((0.3, 0.27), (0.6, 0.4))
"""An area that the arm at home is not over, clear of the bins."""
BELOW = ((0.4, -0.15), (0.65, 0.15))
"""One that it is over."""
EXCHANGE = Exchange(2.0)


def load(*counts: tuple[str, int], area: tuple[tuple[float, float], tuple[float, float]] = ASIDE) -> Spawn:
    """Red and blue items, a third of the cans lying."""
    return Spawn(dict(counts or (("block", 2), ("can", 1))), ("red", "blue"), area, lying=0.3)


def fed(
    when: When | None = None,
    total: int | None = None,
    *,
    of: Spawn | None = None,
    spawn: tuple[Spawn, ...] = (),
    exchange: Exchange | None = EXCHANGE,
) -> SceneDescription:
    """Two bins at y = ±0.55 m and one entry of a feed, when the table is clear unless said otherwise."""
    entry = of or load()
    deliveries = (
        Delivery(
            entry.counts, entry.colours, entry.area, lying=entry.lying, when=when or WhenClear(), total=total
        ),
    )
    return cell(spawn=spawn, deliveries=deliveries, exchange=exchange)


def build(backend: Backend, scene: SceneDescription, seed: int = 4) -> Hardware:
    hardware = PhysicsHardware if backend == "physics" else KinematicHardware
    return hardware(scene, panda(), seed)


def wait(hardware: Hardware, seconds: float) -> None:
    for _ in range(round(seconds / hardware.period)):
        hardware.step()


def turn_to(hardware: Hardware, name: str, seconds: float = 1.5) -> None:
    """Move the arm to a named pose."""
    start, goal = hardware.arm.read().position, np.array(panda().named[name])
    steps = round(seconds / hardware.period)
    for k in range(1, steps + 1):
        hardware.arm.follow(start + (goal - start) * k / steps, (goal - start) / seconds)
        hardware.step()
    hardware.arm.follow(goal, np.zeros_like(goal))
    wait(hardware, 0.1)


def told(hardware: Hardware) -> list[str]:
    return [event.message for event in hardware.take_events()]


def places(hardware: Hardware) -> dict[str, Vector3]:
    """Where everything is that is there."""
    return {str(body.id): body.pose.position for body in hardware.truth() if body.present}


def moved(hardware: Hardware, to: Mapping[str, Vector3]) -> None:
    """Set items elsewhere, through a checkpoint, and let them come to rest: as if a robot had been there."""
    plain = hardware.checkpoint().to_plain()
    for item in plain["items"]:
        if item["id"] in to:
            (item.get("pose") or item)["position"] = to[item["id"]]
            item["asleep"] = False
    if isinstance(hardware, PhysicsHardware):
        hardware.restore(Checkpoint.from_plain(plain))
    else:
        for item in plain["items"]:
            item.pop("asleep", None)
        hardware.restore(KinematicState.from_plain(plain))
    wait(hardware, 0.5)


def resumed(hardware: Hardware) -> Hardware:
    """A fresh one that goes on from a checkpoint of this one, which went through JSON."""
    plain = json.loads(json.dumps(hardware.checkpoint().to_plain()))
    scene, robot, seed = hardware.scene, hardware.robot, hardware.seed
    if isinstance(hardware, PhysicsHardware):
        return PhysicsHardware.resume(scene, robot, seed, Checkpoint.from_plain(plain))
    return KinematicHardware.resume(scene, robot, seed, KinematicState.from_plain(plain))


def digest(hardware: Hardware, seconds: float) -> str:
    """Of all that can be seen of items and lines while so much time passes."""
    seen = hashlib.sha256()
    for _ in range(round(seconds / hardware.period)):
        hardware.step()
        seen.update(repr((hardware.truth(), hardware.feed.read(), told(hardware))).encode())
        seen.update(hardware.arm.read().position.tobytes())
    return seen.hexdigest()

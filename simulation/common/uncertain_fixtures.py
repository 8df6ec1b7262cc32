"""Where fixtures really stand whose place is not known exactly: drawn from the seed, told to nobody."""

from __future__ import annotations

import math
from dataclasses import replace

from ...world.random_streams import RandomStreams
from ...world.scene.description import CERTAIN, Fixture, SceneDescription
from ...world.values import Pose, quaternion_product


def displace_fixtures(scene: SceneDescription, seed: int, *, level: bool = False) -> SceneDescription:
    """The scene with its fixtures where they really stand. It is the simulation's own: what the robot is told
    is the scene as it was given. `level`: shifted and turned just so, but not tilted."""
    if all(fixture.uncertainty == CERTAIN for fixture in scene.fixtures):
        return scene
    streams = RandomStreams(seed)
    return replace(scene, fixtures=tuple(_displaced(fixture, streams, level) for fixture in scene.fixtures))


def _displaced(fixture: Fixture, streams: RandomStreams, level: bool) -> Fixture:
    """Shifted along its own x and y and turned about its own z, evenly within the bounds, and tilted about a
    level axis through its middle, whichever."""
    most = fixture.uncertainty
    if most == CERTAIN:
        return fixture
    rng = streams.at(f"fixture/{fixture.id}", 0)
    x, y = (float(rng.uniform(-most.position, most.position)) for _ in range(2))
    yaw = float(rng.uniform(-most.angle, most.angle))
    tilt, towards = float(rng.uniform(0.0, most.angle)), float(rng.uniform(-math.pi, math.pi))
    tilt = 0.0 if level else tilt
    lean = math.sin(tilt / 2)
    leaning = (lean * math.cos(towards), lean * math.sin(towards), 0.0, math.cos(tilt / 2))
    turning = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    really = Pose((x, y, 0.0), quaternion_product(leaning, turning))
    return replace(fixture, pose=fixture.pose @ really)

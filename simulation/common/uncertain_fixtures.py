"""True poses of fixtures with uncertain placement: drawn from the seed, known to the simulation alone."""

from __future__ import annotations

import math
from dataclasses import replace

from ...world.random_streams import RandomStreams
from ...world.scene.description import NO_UNCERTAINTY, Fixture, SceneDescription
from ...world.values import Pose, quaternion_product


def displace_fixtures(scene: SceneDescription, seed: int, *, level: bool = False) -> SceneDescription:
    """Return the scene with its fixtures at their true poses, for the simulation only; the robot gets the
    scene as given. `level`: fixtures are shifted and turned, but not tilted."""
    if all(fixture.uncertainty == NO_UNCERTAINTY for fixture in scene.fixtures):
        return scene
    streams = RandomStreams(seed)
    return replace(scene, fixtures=tuple(_displaced(fixture, streams, level) for fixture in scene.fixtures))


def _displaced(fixture: Fixture, streams: RandomStreams, level: bool) -> Fixture:
    """Return the fixture displaced within its bounds. It is shifted along its x and y and turned about its z,
    evenly distributed, and tilted about a random level axis through its middle."""
    most = fixture.uncertainty
    if most == NO_UNCERTAINTY:
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

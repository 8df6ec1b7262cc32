"""Cameras of the kinematic backend: ideal images of a pybullet stage on which bodies are placed, never
moved."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from picktree.simulation import DeviceFaults, SpawnedItem, mislabelled, noisy_colour, noisy_depth
from picktree.simulation.physics import (
    CameraRenderer,
    Client,
    ItemShapes,
    RenderedImage,
    RobotBody,
    StaticScene,
    add_item,
    add_obstacle,
    in_front,
    pb,
)
from picktree.world import Array, Clock, NoImage, ObjectId, Pose, RandomStreams, RgbdImage, Shape
from picktree.world.robot_model import RobotDescription
from picktree.world.scene import CameraDescription, Fixture, SceneDescription

from .bodies import KinematicBodies, KinematicBody


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Configuration of the robot: joints (n,), rad, opening, m, and the TCP in the world, true and
    believed."""

    position: Array
    width: float
    tool: Pose
    believed_tool: Pose


class RenderStage:
    """Render stage: a pybullet client for images only, created with the first image."""

    def __init__(self, scene: SceneDescription, robot: RobotDescription, period: float) -> None:
        self._scene = scene
        self._robot = robot
        self._period = period
        self._client = -1
        self._numbers: dict[ObjectId, int] = {}
        self._shapes: dict[ObjectId, Shape] = {}
        self._known: ItemShapes = {}
        self._obstacles: dict[Fixture, int] = {}
        self._scenery: StaticScene | None = None

    def render(
        self,
        camera: CameraDescription,
        posture: Posture,
        bodies: Iterable[KinematicBody],
        obstacles: Iterable[Fixture] = (),
        moved: Pose | None = None,
    ) -> RenderedImage:
        """Render the present `bodies` and `obstacles` and the robot in front of the static scene. `moved`:
        true optical frame in the frame before a fault."""
        if self._scenery is None:
            self._scenery = self._open()
        joints = (*posture.position.tolist(), *self._body.fingers.positions(posture.width))
        self._body.place(joints, (0.0,) * len(joints))
        self._set(bodies)
        self._replace_obstacles(obstacles)
        view = CameraRenderer(camera)
        optical = view.true_frame(posture.tool)
        if moved is not None:
            optical = optical @ moved
        return in_front(view.render(self._client, optical), self._scenery.behind(view, optical))

    def _open(self) -> StaticScene:
        owner = Client()
        self._client = owner.id
        self._body = RobotBody(self._robot, owner, self._period)
        self._body.load()
        return StaticScene(self._scene)

    def _set(self, bodies: Iterable[KinematicBody]) -> None:
        """Place the given items on the stage and remove all others."""
        there = {body.id: body for body in bodies}
        for name in [name for name in self._numbers if name not in there]:
            pb.removeBody(self._numbers.pop(name), self._client)
        for name, body in there.items():
            if name in self._numbers and self._shapes[name] != body.entry.shape:
                pb.removeBody(self._numbers.pop(name), self._client)
            if name not in self._numbers:
                self._shapes[name] = body.entry.shape
                item = SpawnedItem(name, body.entry, body.colour, body.pose, dropped=False)
                self._numbers[name] = add_item(item, body.pose, self._client, self._known)
            position, orientation = body.pose.position, body.pose.orientation
            pb.resetBasePositionAndOrientation(self._numbers[name], position, orientation, self._client)

    def _replace_obstacles(self, obstacles: Iterable[Fixture]) -> None:
        there = tuple(obstacles)
        for gone in [body for body in self._obstacles if body not in there]:
            pb.removeBody(self._obstacles.pop(gone), self._client)
        for body in there:
            if body not in self._obstacles:
                self._obstacles[body] = add_obstacle(body, self._client)


class KinematicCamera:
    """`protocols.Camera` of the kinematic backend; noise comes from faults only."""

    def __init__(
        self,
        camera: CameraDescription,
        stage: RenderStage,
        bodies: KinematicBodies,
        clock: Clock,
        posture: Callable[[], Posture],
        obstacles: Callable[[], Iterable[Fixture]] = tuple,
        faults: DeviceFaults | None = None,
        streams: RandomStreams | None = None,
    ) -> None:
        """`faults`: active faults of the cameras; `streams`: random streams for the noise of faults."""
        self._faults = faults or DeviceFaults(())
        self._streams = streams or RandomStreams(0)
        self._camera = camera
        self._stage = stage
        self._bodies = bodies
        self._clock = clock
        self._posture = posture
        self._obstacles = obstacles

    def capture(self) -> RgbdImage:
        name = self._camera.name
        trouble = self._faults.cameras.get(name)
        if self._faults.dropped(name):
            raise NoImage(f"{name} gave no image")
        posture = self._posture()
        moved = None if trouble is None else trouble.moved
        picture = self._stage.render(self._camera, posture, self._bodies.present, self._obstacles(), moved)
        depth, colour = np.where(np.isfinite(picture.depth), picture.depth, np.float32(0.0)), picture.colour
        if trouble is not None:
            colour = mislabelled(colour, trouble.shown)
        if trouble is not None and trouble.noise != 1.0:
            rng = self._streams.at(f"sensor/camera/{name}", round(1000.0 * self._clock.now))
            colour = noisy_colour(colour, rng, trouble.noise)
            depth = noisy_depth(depth, self._camera, rng, trouble.noise)
        return RgbdImage(
            camera=name,
            colour=colour,
            depth=depth,
            stamp=self._clock.now,
            intrinsics=self._camera.intrinsics,
            camera_in_world=CameraRenderer(self._camera).believed(posture.believed_tool),
        )

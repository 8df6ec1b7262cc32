"""The simulated RGB-D camera: colour, depth and stamp. What belongs to which body never leaves pybullet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..protocols import Clock, Intrinsics, RgbdImage
from ..scene.description import CameraDescription, SceneDescription
from ..streams import Streams
from ..values import Pose
from .bodies import add_scenery
from .client import Client
from .engine import pb
from .noise import noisy_colour, noisy_depth

LIGHT = (0.3, 0.2, 1.0)
"""Direction towards the light, in the world."""


def intrinsics(camera: CameraDescription) -> Intrinsics:
    """Pixels are square. TINY renderer's pixel (u, v) lies at (u, v + 1) of the image plane, which is why
    the centre is half a pixel off the usual place."""
    width, height = camera.size
    focal = height / 2 / math.tan(camera.fov / 2)
    return Intrinsics(width, height, focal, focal, width / 2, height / 2 - 1)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Noise-free colour (h, w, 3), and depth (h, w) along the optical axis, m; infinite where nothing is."""

    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]


class View:
    """A true point of view: renders what stands in a pybullet client."""

    def __init__(self, camera: CameraDescription) -> None:
        self._camera = camera
        self._view = view_matrix(camera.pose @ camera.error)
        up = camera.near * math.tan(camera.fov / 2)
        right = up * camera.size[0] / camera.size[1]
        self._projection = pb.computeProjectionMatrix(-right, right, -up, up, camera.near, camera.far)

    def render(self, client: int) -> Picture:
        width, height = self._camera.size
        _, _, colour, buffer, _ = pb.getCameraImage(
            width,
            height,
            self._view,
            self._projection,
            lightDirection=LIGHT,
            lightColor=(1.0, 1.0, 1.0),
            shadow=0,
            lightAmbientCoeff=0.6,
            lightDiffuseCoeff=0.4,
            lightSpecularCoeff=0.0,
            renderer=pb.ER_TINY_RENDERER,
            flags=pb.ER_NO_SEGMENTATION_MASK,
            physicsClientId=client,
        )
        near, far = self._camera.near, self._camera.far
        z = far * near / (far - (far - near) * buffer.reshape(height, width).astype(np.float64))
        depth = np.where(z < 0.999 * far, z, np.inf).astype(np.float32)
        return Picture(colour.reshape(height, width, 4)[:, :, :3].copy(), depth)


def backgrounds(scene: SceneDescription) -> Mapping[str, Picture]:
    """What each camera sees of fixtures and bins. They never move, and filling the image with a table is
    four fifths of the cost of rendering."""
    client = Client()
    add_scenery(scene, client.id)
    return {camera.name: View(camera).render(client.id) for camera in scene.cameras}


class PhysicsCamera:
    """`protocols.Camera` over pybullet's TINY renderer, which needs no graphics card and is deterministic."""

    def __init__(
        self, camera: CameraDescription, background: Picture, streams: Streams, client: Client, clock: Clock
    ) -> None:
        self.captures = 0
        self._description = camera
        self._background = background
        self._client = client
        self._streams = streams
        self._clock = clock
        self._intrinsics = intrinsics(camera)
        self._view = View(camera)

    def capture(self) -> RgbdImage:
        camera, behind = self._description, self._background
        front = self._view.render(self._client.id)
        nearer = front.depth < behind.depth
        colour = np.where(nearer[:, :, None], front.colour, behind.colour)
        depth = np.where(nearer, front.depth, behind.depth)
        rng = self._streams.at(f"sensor/camera/{camera.name}", self.captures)
        self.captures += 1
        return RgbdImage(
            camera=camera.name,
            colour=noisy_colour(colour, rng),
            depth=noisy_depth(np.where(np.isfinite(depth), depth, np.float32(0.0)), camera, rng),
            stamp=self._clock.now,
            intrinsics=self._intrinsics,
            camera_in_world=camera.pose,
        )


def view_matrix(optical_in_world: Pose) -> list[float]:
    """OpenGL's view matrix, by columns; its camera looks along -z with y up."""
    opengl = optical_in_world.matrix() @ np.diag((1.0, -1.0, -1.0, 1.0))
    return np.linalg.inv(opengl).T.reshape(-1).tolist()

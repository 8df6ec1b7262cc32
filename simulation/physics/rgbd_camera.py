"""Simulated RGB-D camera: colour, depth and stamp. Segmentation by body never leaves pybullet."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.simulation import DeviceFaults, Sticker, mislabelled, noisy_colour, noisy_depth
from picktree.world import Clock, Intrinsics, NoImage, Pose, RandomStreams, RgbdImage
from picktree.world.scene import Bin, CameraDescription, Fixture, SceneDescription

from .bodies import add_scenery
from .engine import Client, pb

LIGHT_DIRECTION = (0.3, 0.2, 1.0)
"""Direction towards the light, in the world."""
HAND_CAMERA_NEAR_CLIP = 0.01
"""Near clipping distance of a camera on the hand, m. The hand hides the surfaces behind it, also where it is
too near to be measured."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedImage:
    """Noise-free image: colour (h, w, 3), and depth (h, w) along the optical axis, m.

    Depth is inf where nothing is, and 0 where something is nearer than the camera can measure.
    """

    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]


class CameraRenderer:
    """Camera renderer: projects the bodies of a pybullet client."""

    def __init__(self, camera: CameraDescription) -> None:
        self.camera = camera
        self._clip = camera.near if camera.on == "world" else min(camera.near, HAND_CAMERA_NEAR_CLIP)
        up = self._clip * math.tan(camera.fov / 2)
        right = up * camera.size[0] / camera.size[1]
        self._projection = pb.computeProjectionMatrix(-right, right, -up, up, self._clip, camera.far)

    def true_frame(self, tool: Pose) -> Pose:
        """Return the true optical frame in the world, for a tool that truly is at `tool`."""
        mounted = self.camera.pose @ self.camera.error
        return mounted if self.camera.on == "world" else tool @ mounted

    def believed(self, tool: Pose) -> Pose:
        """Return the believed optical frame in the world, for a tool believed to be at `tool`."""
        return self.camera.pose if self.camera.on == "world" else tool @ self.camera.pose

    def render(self, client: int, optical: Pose) -> RenderedImage:
        """Render the client's bodies from the true optical frame `optical` in the world."""
        width, height = self.camera.size
        _, _, colour, buffer, _ = pb.getCameraImage(
            width,
            height,
            view_matrix(optical),
            self._projection,
            lightDirection=LIGHT_DIRECTION,
            lightColor=(1.0, 1.0, 1.0),
            shadow=0,
            lightAmbientCoeff=0.6,
            lightDiffuseCoeff=0.4,
            lightSpecularCoeff=0.0,
            renderer=pb.ER_TINY_RENDERER,
            flags=pb.ER_NO_SEGMENTATION_MASK,
            physicsClientId=client,
        )
        near, far = self._clip, self.camera.far
        depth = np.float32(far) - buffer.reshape(height, width) * np.float32(far - near)
        np.divide(np.float32(far * near), depth, out=depth)
        depth[depth >= 0.999 * far] = np.inf
        if near < self.camera.near:
            depth[depth < self.camera.near] = 0.0
        rgb = cv2.cvtColor(colour.reshape(height, width, 4), cv2.COLOR_RGBA2RGB)
        return RenderedImage(np.asarray(rgb, np.uint8), depth)


class StaticScene:
    """Static scene for cameras: fixtures and bins.

    Filling an image with a table is four fifths of the cost of rendering. It is done once for a static
    camera, whose picture later runs of the process share, and again for each image of a moving one.
    """

    def __init__(self, scene: SceneDescription) -> None:
        still = tuple(camera for camera in scene.cameras if camera.on == "world")
        pictures = _still(scene.fixtures, scene.bins, still)
        self._still = {c.name: picture for c, picture in zip(still, pictures, strict=True)}
        self._client: Client | None = None
        self._scene = scene

    def behind(self, view: CameraRenderer, optical: Pose) -> RenderedImage:
        """Return the image without moving bodies, from the true optical frame `optical` in the world."""
        picture = self._still.get(view.camera.name)
        if picture is not None and optical == view.true_frame(Pose()):
            return picture
        if self._client is None:
            self._client = _scenery(self._scene.fixtures, self._scene.bins)
        return view.render(self._client.id, optical)


@lru_cache(maxsize=4)
def _still(
    fixtures: tuple[Fixture, ...], bins: tuple[Bin, ...], cameras: tuple[CameraDescription, ...]
) -> tuple[RenderedImage, ...]:
    """Return the image of each camera that hangs still, without moving bodies: rendered once a process."""
    client = _scenery(fixtures, bins)
    return tuple(view.render(client.id, view.true_frame(Pose())) for view in map(CameraRenderer, cameras))


def _scenery(fixtures: Sequence[Fixture], bins: Sequence[Bin]) -> Client:
    client = Client()
    add_scenery(fixtures, bins, client.id)
    return client


def in_front(front: RenderedImage, behind: RenderedImage) -> RenderedImage:
    """Merge two images from the same place: the nearer surface wins at each pixel."""
    nearer = front.depth < behind.depth
    colour, depth = behind.colour.copy(), np.where(nearer, front.depth, behind.depth)
    cv2.copyTo(front.colour, nearer.view(np.uint8), colour)
    return RenderedImage(colour, depth)


MAX_TAG_GAP = 0.0015
"""Greatest distance of a pixel's surface from the plane of a tag that is drawn on it, m."""
TAG_MODULE, QUIET_MODULES = 4, 0.5
"""Pixels of a module of a drawn tag, and width of its white margin in modules; a 4 × 4 tag has 6 a side."""


def draw_tag(picture: RenderedImage, optical: Pose, view: Intrinsics, sticker: Sticker) -> None:
    """Draw a tag into the colours of a picture, where its surface is seen.

    `optical` is the optical frame in the world. A part that something hides, or that goes beyond its face,
    is not drawn.
    """
    tag = optical.inverse() @ sticker.pose
    middle, normal = np.array(tag.position), tag.rotation()[:, 2]
    half = sticker.size * (0.5 + QUIET_MODULES / 6)
    corners = tag.apply(
        np.array([[x * half, y * half, 0.0] for x, y in ((-1, 1), (1, 1), (1, -1), (-1, -1))])
    )
    if normal @ middle > -1e-3 or corners[:, 2].min() < 0.02:
        return
    focal, centre = np.array([view.fx, view.fy]), np.array([view.cx, view.cy])
    pixels = corners[:, :2] / corners[:, 2:] * focal + centre
    low = np.maximum(np.floor(pixels.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(pixels.max(axis=0)) + 1, (view.width, view.height)).astype(int)
    if np.any(high - low < 2):
        return
    drawn = _tag_image(sticker.number)
    side = float(len(drawn))
    source = np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=np.float32) - 0.5
    matrix = cv2.getPerspectiveTransform(source, (pixels - low).astype(np.float32))
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    shown = cv2.warpPerspective(drawn, matrix, size)
    inside = cv2.warpPerspective(np.full_like(drawn, 255), matrix, size) > 127
    window = slice(low[1], high[1]), slice(low[0], high[0])
    rows, columns = np.mgrid[window]
    rays = np.stack(
        [(columns - centre[0]) / focal[0], (rows - centre[1]) / focal[1], np.ones(rows.shape)], axis=2
    )
    plane = normal @ middle / np.minimum(rays @ normal, -1e-6)
    inside &= np.abs(picture.depth[window] - plane) * np.abs(rays @ normal) < MAX_TAG_GAP
    picture.colour[window][inside] = shown[inside][:, None]


@cache
def _tag_image(number: int) -> NDArray[np.uint8]:
    """Return the picture (n, n) of a tag with its white margin."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    black = np.asarray(cv2.aruco.generateImageMarker(known, number, 6 * TAG_MODULE), np.uint8)
    return np.pad(np.clip(black, 25, 230), round(QUIET_MODULES * TAG_MODULE), constant_values=230)


class PhysicsCamera:
    """`protocols.Camera` over pybullet's TINY renderer, which needs no graphics card and is deterministic."""

    def __init__(
        self,
        camera: CameraDescription,
        scenery: StaticScene,
        streams: RandomStreams,
        client: Client,
        clock: Clock,
        tool: Callable[[], Pose],
        believed_tool: Callable[[], Pose],
        faults: DeviceFaults,
        stickers: Callable[[], Iterable[Sticker]] = tuple,
    ) -> None:
        """`tool` returns the true TCP in the world, `believed_tool` the TCP by the encoders. Both are for a
        camera on the hand only. `stickers` returns the tags on items."""
        self._stickers = stickers
        self.captures = 0
        self._description = camera
        self._scenery = scenery
        self._client = client
        self._streams = streams
        self._clock = clock
        self._tool = tool
        self._believed_tool = believed_tool
        self._faults = faults
        self._intrinsics = camera.intrinsics
        self._view = CameraRenderer(camera)

    def capture(self) -> RgbdImage:
        camera, moving = self._description, self._description.on == "hand"
        trouble = self._faults.cameras.get(camera.name)
        optical = self._view.true_frame(self._tool() if moving else Pose())
        if trouble is not None:
            if self._faults.dropped(camera.name):
                self.captures += 1
                raise NoImage(f"{camera.name} gave no image")
            optical = optical @ trouble.moved
        seen = in_front(
            self._view.render(self._client.id, optical), self._scenery.behind(self._view, optical)
        )
        for sticker in self._stickers():
            draw_tag(seen, optical, self._intrinsics, sticker)
        rng = self._streams.at(f"sensor/camera/{camera.name}", self.captures)
        self.captures += 1
        depth = np.where(np.isfinite(seen.depth), seen.depth, np.float32(0.0))
        colour, times = seen.colour, 1.0
        if trouble is not None:
            colour, times = mislabelled(colour, trouble.shown), trouble.noise
        return RgbdImage(
            camera=camera.name,
            colour=noisy_colour(colour, rng, times),
            depth=noisy_depth(depth, camera, rng, times),
            stamp=self._clock.now,
            intrinsics=self._intrinsics,
            camera_in_world=self._view.believed(self._believed_tool() if moving else Pose()),
        )


def view_matrix(optical_in_world: Pose) -> list[float]:
    """Return OpenGL's view matrix, by columns; its camera looks along -z with y up."""
    opengl = optical_in_world.matrix() @ np.diag((1.0, -1.0, -1.0, 1.0))
    return np.linalg.inv(opengl).T.reshape(-1).tolist()

"""Noise of the sensors, from keyed streams: a reading's noise depends on seed, sensor and step alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..scene.description import CameraDescription, SensorNoise
from ..streams import Streams
from ..values import Array

BLOCK = 240
"""Steps whose noise is drawn at once: a generator costs 15 µs, a number 10 ns."""
VELOCITY_RATE = 10.0
"""Noise of a joint's velocity over that of its position, 1/s: encoders differentiated over about 0.1 s."""
EDGE = 0.01
"""Step of depth between neighbouring pixels that makes an edge, m."""
FLOOR = 2e-4
"""Least standard deviation of a depth that is noisy at all, m."""
COLOUR_NOISE = 4
"""Greatest error of a colour channel, of 255."""


class BlockNoise:
    """Errors of one sensor, (channels,) a step, with a standard deviation each."""

    def __init__(self, streams: Streams, sensor: str, deviations: Sequence[float]) -> None:
        self._streams = streams
        self._stream = f"sensor/{sensor}"
        self._deviations = np.array(deviations)
        self._number = -1
        self._block: Array = np.empty((0, len(deviations)))
        self._numbers: list[list[float]] = []

    def at(self, step: int) -> Array:
        """The errors of that step."""
        row = self._row(step)
        return self._block[row]

    def numbers(self, step: int) -> list[float]:
        """The same as plain numbers, which are cheaper to add up while they are few."""
        row = self._row(step)
        return self._numbers[row]

    def _row(self, step: int) -> int:
        """Of the step within its block, which is drawn if need be."""
        number, row = divmod(step, BLOCK)
        if number != self._number:
            self._number = number
            rng = self._streams.at(self._stream, number)
            self._block = rng.standard_normal((BLOCK, len(self._deviations))) * self._deviations
            self._numbers = self._block.tolist()
        return row


class BodyNoise:
    """Errors of encoders, gripper and wrist at each step, in their units."""

    def __init__(self, noise: SensorNoise, streams: Streams, joints: int) -> None:
        rate = noise.encoder * VELOCITY_RATE
        self._encoders = BlockNoise(streams, "encoders", [noise.encoder] * joints + [rate] * joints)
        self._width = BlockNoise(streams, "width", [noise.width])
        self._wrench = BlockNoise(streams, "wrench", [noise.force] * 3 + [noise.torque] * 3)

    def encoders(self, step: int) -> Array:
        """Errors of the joints' positions, rad, and then velocities, rad/s: (2 n,)."""
        return self._encoders.at(step)

    def width(self, step: int) -> float:
        """Error of the opening, m."""
        return self._width.numbers(step)[0]

    def wrench(self, step: int) -> list[float]:
        """Error of force and torque, (6,) N and Nm."""
        return self._wrench.numbers(step)


def noisy_depth(
    depth: NDArray[np.float32], camera: CameraDescription, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Depth (h, w) with noise that grows with its square, from a floor, and dropouts at edges; 0 stays 0.

    The noise model is that of structured light and stereo: Khoshelham & Elberink (2012), eq. 10.
    """
    noisy = rng.standard_normal(depth.shape, dtype=np.float32)
    share = np.float32(camera.depth_noise / 0.7**2)
    # So near the square promises more than any sensor keeps.
    near = np.nonzero((depth * depth * share < FLOOR) & (depth > 0)) if share > 0 else ()
    least = noisy[near] * np.float32(FLOOR) if near else None
    noisy *= depth
    noisy *= depth * share
    if near and least is not None:
        noisy[near] = least
    noisy += depth
    edges = np.nonzero(_edges(depth))
    lost = rng.random(len(edges[0])) < camera.edge_dropout
    noisy[edges[0][lost], edges[1][lost]] = 0.0
    return noisy


def _edges(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels with a step of depth towards one of the four neighbours."""
    edge = np.zeros(depth.shape, dtype=np.bool_)
    down = np.abs(np.diff(depth, axis=0)) > EDGE
    right = np.abs(np.diff(depth, axis=1)) > EDGE
    edge[1:] |= down
    edge[:-1] |= down
    edge[:, 1:] |= right
    edge[:, :-1] |= right
    return edge


def noisy_colour(colour: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Colour (h, w, 3) with a little evenly distributed noise on each channel."""
    errors = rng.integers(-COLOUR_NOISE, COLOUR_NOISE + 1, colour.shape, dtype=np.int8)
    return np.clip(colour.astype(np.int16) + errors, 0, 255).astype(np.uint8)

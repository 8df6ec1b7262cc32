"""Sensor noise from keyed random streams: a reading's noise depends on seed, sensor and step alone."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import ITEM_COLOURS, Array, Quaternion, RandomStreams, Rgb, rotated
from picktree.world.scene import CameraDescription, SensorNoise

MIN_COLOUR_SATURATION, MIN_COLOUR_BRIGHTNESS = 0.4, 0.08
"""Least saturation, and least brightness, of a pixel that counts as coloured; both 0 … 1."""


def mislabelled(picture: NDArray[np.uint8], others: Mapping[str, str]) -> NDArray[np.uint8]:
    """Return the picture (h, w, 3) with the hues that are keys of `others` replaced by their values.
    Brightness and share of grey stay."""
    if not others:
        return picture
    low, high = picture.min(axis=2).astype(np.float64), picture.max(axis=2).astype(np.float64)
    spread = high - low
    coloured = (spread > MIN_COLOUR_SATURATION * high) & (high > 255 * MIN_COLOUR_BRIGHTNESS)
    names = list(ITEM_COLOURS)
    known = np.array([colorsys.rgb_to_hsv(*rgb)[0] for rgb in ITEM_COLOURS.values()])
    rows, columns = np.nonzero(coloured)
    pixels = picture[rows, columns].astype(np.float64)
    apart = np.abs((_hue(pixels)[:, None] - known + 0.5) % 1.0 - 0.5)
    nearest = apart.argmin(axis=1)
    changed: Array = picture.astype(np.float64)
    for name, other in others.items():
        of = nearest == names.index(name)
        at = rows[of], columns[of]
        base, reach = low[at][:, None], spread[at][:, None]
        pure = _pure(ITEM_COLOURS[other])
        changed[at] = base + reach * pure
    return changed.round().clip(0, 255).astype(np.uint8)


def _hue(pixels: Array) -> Array:
    """Return the hue of coloured pixels (n, 3) as (n,), in turns."""
    high, low = pixels.max(axis=1), pixels.min(axis=1)
    spread = np.maximum(high - low, 1e-9)
    red, green, blue = pixels[:, 0], pixels[:, 1], pixels[:, 2]
    sixths: Array = (red - green) / spread + 4.0
    sixths = np.where(high == green, (blue - red) / spread + 2.0, sixths)
    sixths = np.where(high == red, ((green - blue) / spread) % 6.0, sixths)
    return sixths / 6.0


def _pure(colour: Rgb) -> Array:
    """Return the colour without its grey, (3,) in 0 … 1."""
    rgb = np.array(colour)
    return np.asarray((rgb - rgb.min()) / (rgb.max() - rgb.min()), np.float64)


NOISE_BLOCK_STEPS = 240
"""Number of steps whose noise is drawn at once: a generator costs 15 µs, a number 10 ns."""
VELOCITY_NOISE_RATE = 10.0
"""Noise of a joint's velocity as a multiple of that of its position, 1/s: encoders differentiated over about
0.1 s."""
MIN_EDGE_DEPTH_STEP = 0.01
"""Least difference of depth between neighbouring pixels at an edge, m."""
MIN_DEPTH_DEVIATION = 2e-4
"""Least standard deviation of a depth with noise, m."""
MAX_COLOUR_ERROR = 4
"""Greatest error of a colour channel, of 255."""


class BlockNoise:
    """Noise of one sensor: normal errors (channels,) for each step, with one standard deviation per
    channel."""

    def __init__(self, streams: RandomStreams, sensor: str, deviations: Sequence[float]) -> None:
        self._streams = streams
        self._stream = f"sensor/{sensor}"
        self._deviations = np.array(deviations)
        self._drawn = (-1, 0)
        """Number and stream variant of the present block."""
        self._block: Array = np.empty((0, len(deviations)))
        self._numbers: list[list[float]] = []

    def at(self, step: int) -> Array:
        """Return the errors (channels,) of a step."""
        row = self._row(step)
        return self._block[row]

    def numbers(self, step: int) -> list[float]:
        """Return the errors of a step as plain floats, which are cheaper to add while they are few."""
        row = self._row(step)
        return self._numbers[row]

    def _row(self, step: int) -> int:
        """Return the row of a step in its block; draws the block when it is not the present one."""
        number, row = divmod(step, NOISE_BLOCK_STEPS)
        if (drawn := (number, self._streams.variant)) != self._drawn:
            self._drawn = drawn
            rng = self._streams.at(self._stream, number)
            self._block = rng.standard_normal((NOISE_BLOCK_STEPS, len(self._deviations))) * self._deviations
            self._numbers = self._block.tolist()
        return row


class WrenchBiasNoise:
    """Bias of the wrist's sensor in its own axes: drawn for the run, with a drift in proportion to it.

    The drift is a sum of slow sines, so that it depends on seed and time alone.
    """

    PERIODS = (70.0, 190.0, 430.0)
    """Periods of the drift's sines, s."""
    EVERY = 0.05
    """Interval between two updates of the drift, s."""

    def __init__(self, noise: SensorNoise, streams: RandomStreams) -> None:
        rng = streams.at("sensor/wrench_bias", 0)
        deviations = np.array([noise.force_bias] * 3 + [noise.torque_bias] * 3)
        self._constant = rng.standard_normal(6) * deviations
        self._share = deviations * noise.drift * math.sqrt(2.0 / len(self.PERIODS))
        self._phases = rng.uniform(0.0, 2.0 * math.pi, (len(self.PERIODS), 6))
        self._rates = 2.0 * np.pi / np.array(self.PERIODS)[:, None]
        self._slot = -1
        self._now: list[float] = []
        self.any = bool(deviations.any())

    def at(self, now: float) -> Array:
        """Return the bias (6,) at a time in s, in the sensor's axes, N and Nm."""
        slow = self.EVERY * math.floor(now / self.EVERY + 1e-6)
        waves: Array = np.sin(self._rates * slow + self._phases) - np.sin(self._phases)
        return np.asarray(self._constant + self._share * waves.sum(axis=0), np.float64)

    def in_world(self, now: float, turn: Quaternion) -> tuple[float, ...]:
        """Return the bias (6,) in the world's axes, N and Nm; `turn` is the sensor's orientation in the
        world."""
        slot = math.floor(now / self.EVERY + 1e-6)
        if slot != self._slot:
            self._slot, self._now = slot, self.at(now).tolist()
        a, b, c, d, e, f = self._now
        return (*rotated(turn, (a, b, c)), *rotated(turn, (d, e, f)))


class RobotSensorNoise:
    """Noise of encoders, gripper and wrist sensor at each step, in their units."""

    def __init__(self, noise: SensorNoise, streams: RandomStreams, joints: int) -> None:
        rate = noise.encoder * VELOCITY_NOISE_RATE
        self._encoders = BlockNoise(streams, "encoders", [noise.encoder] * joints + [rate] * joints)
        self._width = BlockNoise(streams, "width", [noise.width])
        self._wrench = BlockNoise(streams, "wrench", [noise.force] * 3 + [noise.torque] * 3)
        self._bias = WrenchBiasNoise(noise, streams)

    def encoders(self, step: int) -> Array:
        """Return the errors of joint positions, rad, then of joint velocities, rad/s: (2 n,)."""
        return self._encoders.at(step)

    def width(self, step: int) -> float:
        """Return the error of the gripper's opening, m."""
        return self._width.numbers(step)[0]

    def wrench(self, step: int, now: float, turn: Quaternion) -> list[float]:
        """Return the error of force and torque in the world's axes, (6,), N and Nm. `turn` is the sensor's
        orientation in the world."""
        noise = self._wrench.numbers(step)
        if not self._bias.any:
            return noise
        return [n + b for n, b in zip(noise, self._bias.in_world(now, turn), strict=True)]


def noisy_depth(
    depth: NDArray[np.float32], camera: CameraDescription, rng: np.random.Generator, times: float = 1.0
) -> NDArray[np.float32]:
    """Return depth (h, w) with noise that grows with its square, from a floor, and dropouts at edges; 0 stays
    0. `times` multiplies the camera's own noise.

    The noise model is that of structured light and stereo: Khoshelham & Elberink (2012), eq. 10.
    """
    noisy = rng.standard_normal(depth.shape, dtype=np.float32)
    share = np.float32(camera.depth_noise * times / 0.7**2)
    floor = MIN_DEPTH_DEVIATION * times
    deviation = cv2.multiply(depth, depth, scale=float(share))
    if share > 0:
        # At short range the quadratic model gives less noise than any real sensor has.
        deviation[(deviation < floor) & (depth > 0)] = floor
    noisy *= deviation
    noisy += depth
    edges = np.nonzero(_edges(depth))
    lost = rng.random(len(edges[0])) < camera.edge_dropout
    noisy[edges[0][lost], edges[1][lost]] = 0.0
    return noisy


def _edges(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return a mask (h, w) of pixels with a step of depth towards one of the four neighbours."""
    edge = np.zeros(depth.shape, dtype=np.bool_)
    down = cv2.absdiff(depth[1:], depth[:-1]) > MIN_EDGE_DEPTH_STEP
    right = cv2.absdiff(depth[:, 1:], depth[:, :-1]) > MIN_EDGE_DEPTH_STEP
    edge[1:] |= down
    edge[:-1] |= down
    edge[:, 1:] |= right
    edge[:, :-1] |= right
    return edge


_COLOUR_ERRORS = (np.arange(256) * (2 * MAX_COLOUR_ERROR + 1) // 256 - MAX_COLOUR_ERROR).astype(np.int8)
"""Colour error for each value of a random byte."""


def noisy_colour(
    colour: NDArray[np.uint8], rng: np.random.Generator, times: float = 1.0
) -> NDArray[np.uint8]:
    """Return colour (h, w, 3) with evenly distributed noise on each channel; `times` multiplies it."""
    raw = rng.bit_generator.random_raw(-(-colour.size // 8)).view(np.uint8)[: colour.size]
    errors = cv2.LUT(raw.reshape(len(colour), -1), _COLOUR_ERRORS).reshape(colour.shape)
    if times != 1.0:
        errors = np.round(errors * times).astype(np.int16)
    return np.asarray(cv2.add(colour, errors, dtype=cv2.CV_8U), np.uint8)  # saturated

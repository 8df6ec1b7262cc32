"""Recogniser of a cell: items in pictures by the plant's own truth, with noise and wrong labels.

It replaces a network that recognises items. The pose of an item is that in the true camera's frame, at
the time of the answer: in lockstep nothing moves between a picture and its answer.
"""

from __future__ import annotations

import math
import socket
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from picktree.drivers import protocol

from .cell_description import CellError, ItemEntry
from .cell_model import SEEN_GROUPS
from .plant import Plant

TURN_PER_METRE: Final = 10.0
"""Standard deviation of an item's turn for that of its position, rad/m."""
LEAST_PIXELS: Final = 12
"""Least number of visible pixels of an item that is found."""
CONFIDENCE: Final = 0.9
"""Confidence in each label, the wrong ones included."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecogniserFaults:
    """Errors of a recogniser."""

    noise: float = 0.0
    """Standard deviation of a position along each axis, m."""
    wrong_labels: float = 0.0
    """Probability that an item of a picture gets kind and colour of another one."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise < 1.0:
            raise CellError(f"--perception-noise {self.noise:g}: write m, at least 0, as in 0.003")
        if not 0.0 <= self.wrong_labels <= 1.0:
            raise CellError(f"--wrong-labels {self.wrong_labels:g}: write a share, as in 0.05")


class CellRecogniser:
    """Recogniser of a cell's items."""

    def __init__(
        self,
        plant: Plant,
        faults: RecogniserFaults,
        seed: int,
        lock: Lock,
        token: str = "",
        gives: str = "pose",
    ) -> None:
        """`lock`: held while the plant is read; `token`: what a client must know; `gives`: one of `GIVES`."""
        self._plant, self._faults, self._lock = plant, faults, lock
        self._token, self._gives = token, gives
        self._rng = np.random.default_rng([seed, 4])
        self._kinds = tuple(sorted({item.kind for item in plant.cell.items if item.kind}))
        model = plant.parts.model
        self._item_of_geom = np.full(len(model.geom_rgba) + 1, -1)
        for number, item in enumerate(plant.cell.items):
            body = model.body(f"item/{item.id}").id
            first = model.body_geomadr[body]
            self._item_of_geom[first : first + model.body_geomnum[body]] = number
        """Number of the item of each geom; -1: none. The last entry is for rays that hit nothing."""

    def serve(self, channel: protocol.Channel) -> None:
        """Serve one client until it leaves. Raises ProtocolError when it breaks the protocol."""
        hello = channel.receive()
        if not isinstance(hello, protocol.Hello) or protocol.Wish.RECOGNITION not in hello.wishes:
            channel.send(protocol.Refusal(protocol.Refused.MESSAGE, "this process recognises items only"))
            return
        if self._token and not protocol.same_token(self._token, hello.token):
            channel.send(protocol.Refusal(protocol.Refused.TOKEN, "the token is not the recogniser's"))
            return
        channel.send(protocol.RecogniserInfo("picktree_cell", "truth with noise", self._kinds))
        while True:
            message = channel.receive()
            if isinstance(message, protocol.Bye):
                return
            if not isinstance(message, protocol.Look):
                raise protocol.ProtocolError(f"a client does not send {type(message).__name__}")
            with self._lock:
                found = self.found(message)
            channel.send(protocol.Findings(message.stamp, found))

    def found(self, look: protocol.Look) -> tuple[protocol.Finding, ...]:
        """Return the visible items of a picture. Raises ProtocolError for a camera that the cell lacks."""
        origin, rotation = self._camera(look.camera.name)
        items = self._items_seen(look.camera, origin, rotation)
        findings = list[protocol.Finding]()
        for number, item in enumerate(self._plant.cell.items):
            rows, columns = np.nonzero(items == number)
            if len(rows) < LEAST_PIXELS or not item.kind:
                continue
            label, pose = self._label(item), self._pose(item, origin, rotation)
            box = int(columns.min()), int(rows.min()), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1
            mask = np.zeros((box[3], box[2]), bool)
            mask[rows - box[1], columns - box[0]] = True
            sigma = self._faults.noise
            findings.append(
                protocol.Finding(
                    label.kind,
                    box,
                    label.colour_name,
                    CONFIDENCE,
                    protocol.pack_mask(mask) if self._gives != "box" else b"",
                    pose if self._gives == "pose" else (),
                    (max(sigma, 5e-4), max(TURN_PER_METRE * sigma, 5e-3)),
                )
            )
        return tuple(findings)

    def _label(self, item: ItemEntry) -> ItemEntry:
        """Return the item whose kind and colour are reported for an item."""
        wrong = self._rng.random() < self._faults.wrong_labels
        others = [
            each
            for each in self._plant.cell.items
            if each.kind and (each.kind, each.colour_name) != (item.kind, item.colour_name)
        ]
        chosen = int(self._rng.integers(len(others))) if others else 0
        return others[chosen] if wrong and others else item

    def _pose(self, item: ItemEntry, origin: Array, rotation: Array) -> protocol.Numbers:
        """Return the pose of an item in the camera's optical frame, with noise."""
        plant, rng = self._plant, self._rng
        at = plant.parts.item_q[item.id]
        position, quaternion = plant.data.qpos[at : at + 3], plant.data.qpos[at + 3 : at + 7]
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, quaternion)
        within = rotation.T @ (position - origin) + self._faults.noise * rng.standard_normal(3)
        error = _rotation(TURN_PER_METRE * self._faults.noise * rng.standard_normal(3))
        reported = _quaternion(error @ rotation.T @ turn.reshape(3, 3))
        return (*map(float, within), *map(float, reported))

    def _camera(self, name: str) -> tuple[Array, Array]:
        """Return position (3,) and rotation (3, 3) of a camera's true optical frame in the world."""
        entry = next((each for each in self._plant.cell.cameras if each.name == name), None)
        if entry is None:
            raise protocol.ProtocolError(f"the cell has no camera {name!r}")
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.array(entry.frame.wxyz))
        position, rotation = np.array(entry.frame.at), turn.reshape(3, 3)
        if not entry.on_hand:
            return position, rotation
        at, axes = self._plant.tcp()
        return at + axes @ position, axes @ rotation

    def _items_seen(self, lens: protocol.CameraInfo, origin: Array, rotation: Array) -> NDArray[np.intp]:
        """Return the number of the item that each pixel (h, w) shows; -1: none."""
        rows, columns = np.mgrid[: lens.height, : lens.width]
        rays = np.stack(
            [(columns - lens.cx) / lens.fx, (rows - lens.cy) / lens.fy, np.ones(rows.shape)], axis=2
        ).reshape(-1, 3)
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        count = len(rays)
        seen = np.zeros(6, np.uint8)
        seen[list(SEEN_GROUPS)] = 1
        geoms, reach, normals = np.empty(count, np.int32), np.empty(count), np.empty(3 * count)
        mujoco.mj_multiRay(
            self._plant.parts.model,
            self._plant.data,
            origin,
            np.ascontiguousarray(rays @ rotation.T).ravel(),
            seen,
            True,
            -1,
            geoms,
            reach,
            normals,
            count,
            10.0,
        )
        return self._item_of_geom[geoms].reshape(lens.height, lens.width)


def _rotation(turn: Array) -> Array:
    """Return the rotation (3, 3) of a rotation vector (3,), rad (Rodrigues)."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / angle if angle > 0.0 else turn
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew


def _quaternion(rotation: Array) -> Array:
    """Return the unit quaternion x, y, z, w of a rotation (3, 3), as an eigenvector (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    matrix = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    return np.linalg.eigh(matrix)[1][:, -1]


def listen(address: protocol.Address) -> socket.socket:
    """Listen for clients. Raises CellError when nothing can listen there."""
    try:
        return address.listen()
    except OSError as error:
        raise CellError(f"nothing can listen at {address}: {error.strerror or error}") from None


def serve_recogniser(recogniser: CellRecogniser, listener: socket.socket) -> None:
    """Serve clients one after another, without an end."""
    while True:
        try:
            connection, _ = listener.accept()
        except OSError:
            return  # The listener was closed.
        with connection, suppress(protocol.ProtocolError):
            recogniser.serve(protocol.Channel(connection))

"""Recogniser in another process: `world.Recogniser` over the protocol of drivers.

Its answers are checked before anything believes them. A process that is gone or late is called again with the
next picture.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Final

import numpy as np

from picktree.files import PicktreeError
from picktree.world import COLOURS, NotRecognised, Pose, RecognisedItem, RgbdImage
from picktree.world.scene import CatalogueEntry

from . import protocol

ANSWER_TIME: Final = 5.0
"""Longest wait for an answer about a picture, s of wall time."""
BOX_MARGIN: Final = 5.0
"""Distance beside a box of pixels at which an item's middle may be, beyond the box's own size, pixels."""


class ExternalRecogniser:
    """`world.Recogniser` of another process.

    Raises PicktreeError when nobody listens, or the process knows no kind of the catalogue.
    """

    def __init__(self, address: str, catalogue: Iterable[CatalogueEntry]) -> None:
        try:
            self.address = protocol.Address.parse(address)
            self._token = os.environ.get(protocol.TOKEN_VARIABLE, "")
            self.address.require_token(self._token)
        except protocol.ProtocolError as error:
            raise PicktreeError(f"--perception-at: {error}") from None
        self._wanted = frozenset(entry.kind for entry in catalogue)
        self._kinds = frozenset[str]()
        self._channel: protocol.Channel | None = None
        self.name = ""
        """Name and model that the process tells."""
        try:
            self._connected()
        except protocol.ProtocolError as error:
            raise PicktreeError(f"--perception-at {self.address}: {error}; start its process first") from None
        if not self._wanted & self._kinds:
            self.close()
            known = ", ".join(sorted(self._kinds)) or "nothing"
            raise PicktreeError(
                f"--perception-at {self.address}: it knows {known}, but the scene's catalogue has "
                f"{', '.join(sorted(self._wanted))}"
            )

    def recognise(self, image: RgbdImage) -> tuple[RecognisedItem, ...]:
        """Return the items in a picture; those of kinds that the catalogue lacks are left out.

        Raises NotRecognised when no answer comes in time, or a wrong one: the connection is then closed, so
        that a late answer is never taken for another picture.
        """
        try:
            channel = self._connected()
            channel.send(_look(image))
            answer = channel.receive()
            if isinstance(answer, protocol.Refusal):
                raise protocol.ProtocolError(f"it refuses: {answer.text}")
            if not isinstance(answer, protocol.Findings):
                raise protocol.ProtocolError(f"it answers with {type(answer).__name__}")
            if abs(answer.stamp - image.stamp) > 1e-6:
                raise protocol.ProtocolError(
                    f"it answers for a picture at {answer.stamp:.3f} s, not at {image.stamp:.3f} s"
                )
            found = [self._item(each, image) for each in answer.items]
        except protocol.ProtocolError as error:
            self.close()
            raise NotRecognised(f"the perception process at {self.address}: {error}") from None
        return tuple(each for each in found if each.kind in self._wanted)

    def close(self) -> None:
        """End the connection."""
        if self._channel is not None:
            self._channel.close()
        self._channel = None

    def _connected(self) -> protocol.Channel:
        """Return the connection, a new one if need be. Raises ProtocolError."""
        if self._channel is not None:
            return self._channel
        try:
            connection = self.address.connect(ANSWER_TIME)
        except OSError as error:
            raise protocol.ProtocolError(f"nobody listens ({error.strerror or error})") from None
        connection.settimeout(ANSWER_TIME)
        self._channel = channel = protocol.Channel(connection)
        channel.send(protocol.Hello(protocol.Wish.RECOGNITION, self._token))
        answer = channel.receive()
        if isinstance(answer, protocol.Refusal):
            raise protocol.ProtocolError(f"it refuses: {answer.text}")
        if not isinstance(answer, protocol.RecogniserInfo):
            raise protocol.ProtocolError(f"it recognises nothing: it answers with {type(answer).__name__}")
        self.name, self._kinds = f"{answer.name} {answer.model}".strip(), frozenset(answer.kinds)
        return channel

    def _item(self, each: protocol.Finding, image: RgbdImage) -> RecognisedItem:
        """Return a finding as an item. Raises ProtocolError for one that cannot be in this picture."""
        if each.kind not in self._kinds:
            raise protocol.ProtocolError(f"it finds a {each.kind!r}, which it has not named among its kinds")
        if each.colour and each.colour not in COLOURS:
            raise protocol.ProtocolError(
                f"the {each.kind} has the colour {each.colour!r}; the colours are {', '.join(COLOURS)}"
            )
        lens = image.intrinsics
        column, row, columns, rows = each.box
        if not (0 < columns <= lens.width - column and 0 < rows <= lens.height - row):
            raise protocol.ProtocolError(
                f"the {each.kind} is at columns {column} to {column + columns} and rows {row} to "
                f"{row + rows} of {lens.width} × {lens.height} pixels"
            )
        pose = None
        if each.pose:
            x, y, z, *turn = each.pose
            if not (z > 0.0 and _is_by_box(lens.fx * x / z + lens.cx, column, columns)) or not _is_by_box(
                lens.fy * y / z + lens.cy, row, rows
            ):
                raise protocol.ProtocolError(
                    f"the {each.kind} is at x {x:.3f}, y {y:.3f}, z {z:.3f} m, which is not in its box of "
                    "pixels"
                )
            length = float(np.linalg.norm(turn))
            pose = Pose((x, y, z), (turn[0] / length, turn[1] / length, turn[2] / length, turn[3] / length))
        at_rows, at_columns = np.nonzero(protocol.unpack_mask(each))
        return RecognisedItem(
            each.kind,
            each.colour,
            each.confidence,
            at_rows + row,
            at_columns + column,
            bool(each.mask),
            pose,
            *each.deviation,
        )


def _is_by_box(pixel: float, first: int, count: int) -> bool:
    """Return whether a row or column is in a box of pixels, or at most the box's size away from it.

    The picture's border cuts through items, and other items hide parts of them.
    """
    return first - count - BOX_MARGIN <= pixel <= first + 2 * count + BOX_MARGIN


def _look(image: RgbdImage) -> protocol.Look:
    lens, frame = image.intrinsics, image.camera_in_world
    camera = protocol.CameraInfo(
        image.camera, "", lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy
    )
    data = protocol.join_picture(image.colour, image.depth)
    return protocol.Look(camera, image.stamp, (*frame.position, *frame.orientation), data)

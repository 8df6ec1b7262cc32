"""Image files of the log: colour as JPEG, because the sensor's noise is not worth its size; depth as PNG.

The depth is not compressed here: the log compresses it together with all other messages, faster and smaller.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ...files.errors import PicktreeError

_PNG_SETTINGS = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 0),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP),
)
_JPEG_SETTINGS = (
    cv2.IMWRITE_JPEG_QUALITY,
    92,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
)


def encode_colour(image: NDArray[np.uint8]) -> bytes:
    """Encode RGB (h, w, 3) as JPEG."""
    return _encoded(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), _JPEG_SETTINGS)


def encode_depth(depth: NDArray[np.float32]) -> bytes:
    """Encode depth (h, w) in m as 16-bit PNG in mm; 0 where unknown."""
    millimetres = np.clip(np.nan_to_num(depth) * 1000.0 + 0.5, 0, 65535)
    return _encoded(".png", millimetres.astype(np.uint16), _PNG_SETTINGS)


def decode_colour(data: bytes) -> NDArray[np.uint8]:
    """Decode RGB (h, w, 3). Raises ValueError for data that is no image."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("not an image")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8)


def decode_depth(data: bytes) -> NDArray[np.float32]:
    """Decode depth (h, w) in m, 0 where unknown. Raises ValueError for data that is no image."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 2:
        raise ValueError("not a depth image")
    return image.astype(np.float32) / np.float32(1000.0)


def write_picture(path: str, image: NDArray[np.uint8]) -> None:
    """Write RGB (h, w, 3) into a file in the format of its suffix. Raises OSError when that fails."""
    Path(path).write_bytes(_encoded(Path(path).suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), ()))


def require_picture_name(path: Path) -> None:
    """Raise PicktreeError when the suffix of the path is not that of a picture format."""
    if not cv2.haveImageWriter(path.name):
        raise PicktreeError(f"{path}: the picture cannot be written: name it {path.stem}.png")


def _encoded(ending: str, image: NDArray[np.uint16] | cv2.typing.MatLike, settings: tuple[int, ...]) -> bytes:
    done, data = cv2.imencode(ending, image, settings)
    if not done:
        raise ValueError("the image cannot be encoded")
    return data.tobytes()

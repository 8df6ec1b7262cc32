"""Images panel: the cameras' images at their times, small enough for the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ...logs.run_log import CameraImage, Stamped
from ...logs.schema.event_records import ImageEvent
from ..run import Run
from .packing import Packable, Section

IMAGE_BYTE_LIMIT: Final = 1_000_000
"""Maximum size of all images together, bytes; base64 adds a third."""
_WEBP_QUALITIES: Final = (80, 60, 45)
_MIN_IMAGE_WIDTH: Final = 160
"""Minimum width of a readable image, pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportImage:
    """Image as the page shows it: WebP files of colour and depth."""

    camera: str
    time: float
    colour: bytes
    depth: bytes
    nearest: float
    """Depth of the first colour of the scale, m; `farthest` is that of the last."""
    farthest: float


def pack_images(run: Run, budget: int = IMAGE_BYTE_LIMIT) -> Section:
    """Pack all images, or as many as `budget` bytes hold, evenly over the run."""
    shots = run.shots
    if not shots:
        return Section("images", {"empty": "No camera took an image in this run."})
    pictures = images_within_budget(shots, budget)
    images = ((at.time, at.record) for at in run.events if isinstance(at.record, ImageEvent))
    findings = {round(time, 3): image.findings for time, image in images}
    left_out = len(shots) - len(pictures)
    return Section(
        "images",
        {
            "images": [_packed(picture, findings.get(round(picture.time, 3), ())) for picture in pictures],
            "note": f"{left_out} of {len(shots)} images are left out to keep this page small."
            if left_out
            else "",
        },
    )


def images_within_budget(shots: Sequence[Stamped[CameraImage]], budget: int) -> list[ReportImage]:
    """Return the images in the best quality that `budget` allows.

    When even the smallest are too many, return fewer, the first and the last among them. The others are not
    decoded.
    """
    some = [shots[k] for k in range(0, len(shots), max(len(shots) // 8, 1))]
    for width, quality in _widths_and_qualities(some[0].record.colour.shape[1]):
        mean = sum(map(_size, _pictures(some, width, quality))) / len(some)
        if 1.1 * mean * len(shots) <= budget:
            return _pictures(shots, width, quality)
    width, quality = _widths_and_qualities(some[0].record.colour.shape[1])[-1]
    mean = sum(map(_size, _pictures(some, width, quality))) / len(some)
    count = max(int(budget / (1.1 * mean)), 1)
    chosen = sorted({round(float(k)) for k in np.linspace(0, len(shots) - 1, count)})
    return _pictures((shots[k] for k in chosen), width, quality)


def _widths_and_qualities(width: int) -> list[tuple[int, int]]:
    """Return widths and qualities, from the best to the lowest."""
    whole = min(width, 640)
    small = [(max(whole // 2, _MIN_IMAGE_WIDTH), 60)] if whole > _MIN_IMAGE_WIDTH else []
    return [*((whole, quality) for quality in _WEBP_QUALITIES), *small]


def _size(picture: ReportImage) -> int:
    return len(picture.colour) + len(picture.depth)


def _pictures(shots: Iterable[Stamped[CameraImage]], width: int, quality: int) -> list[ReportImage]:
    return [_picture(shot, width, quality) for shot in shots]


def _picture(at: Stamped[CameraImage], width: int, quality: int) -> ReportImage:
    shot = at.record
    known = shot.depth[shot.depth > 0.0]
    nearest, farthest = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    colour = cv2.cvtColor(shot.colour, cv2.COLOR_RGB2BGR).astype(np.uint8)
    return ReportImage(
        shot.camera,
        at.time,
        _webp(colour, width, quality),
        _webp(_depth_image(shot.depth, nearest, farthest), width, quality),
        nearest,
        farthest,
    )


def _depth_image(depth: NDArray[np.float32], nearest: float, farthest: float) -> NDArray[np.uint8]:
    """Return depth as BGR: bright is near, black is unknown."""
    span = max(farthest - nearest, 1e-6)
    levels = np.clip(255.0 * (farthest - depth) / span, 0.0, 255.0).astype(np.uint8)
    coloured = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS).astype(np.uint8)
    coloured[depth <= 0.0] = 0
    return coloured


def _webp(image: NDArray[np.uint8], width: int, quality: int) -> bytes:
    height = max(round(image.shape[0] * width / image.shape[1]), 1)
    if width < image.shape[1]:
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
    done, data = cv2.imencode(".webp", image, (cv2.IMWRITE_WEBP_QUALITY, quality))
    if not done:
        raise ValueError("the image cannot be encoded")
    return data.tobytes()


def _packed(picture: ReportImage, findings: Sequence[str]) -> Packable:
    return {
        "camera": picture.camera,
        "time": picture.time,
        "colour": np.frombuffer(picture.colour, dtype=np.uint8),
        "depth": np.frombuffer(picture.depth, dtype=np.uint8),
        "nearest": picture.nearest,
        "farthest": picture.farthest,
        "findings": list(findings),
    }

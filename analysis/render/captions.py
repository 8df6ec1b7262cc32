"""Captions in an image: time, activity of the robot, progress, and failures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2

from .rasterizer import Picture

Colour: TypeAlias = tuple[int, int, int]

_INK: Colour = (38, 43, 51)
_PALE: Colour = (92, 100, 112)
_PAPER: Colour = (255, 255, 255)
_ALARM: Colour = (190, 32, 38)
_BAR: Colour = (46, 110, 190)
_REGULAR, _SEMIBOLD = 400, 600


@dataclass(frozen=True, slots=True)
class CaptionFailure:
    cause: str
    message: str


@dataclass(frozen=True, slots=True)
class Caption:
    time: float
    """Simulated time, s."""
    node: str = ""
    """Running node, in a word or two."""
    message: str = ""
    """Message of the running node."""
    done: str = ""
    """Number of items done, as text."""
    note: str = ""
    """Content of the image, or speed of the film."""
    trouble: CaptionFailure | None = None
    elapsed: float | None = None
    """Share 0 … 1 of the run that has passed; None draws no bar."""
    marks: tuple[float, ...] = ()
    """Positions of failures on the bar, 0 … 1."""


def write(picture: Picture, caption: Caption) -> None:
    """Draw the caption into the image: a line at the foot, and a failure above it."""
    height, width = picture.shape[:2]
    unit = height / 600
    bar = max(2, round(4 * unit)) if caption.elapsed is not None else 0
    line = round(38 * unit)
    _veil(picture, (0, height - line - bar, width, line + bar), _PAPER, 0.82)
    size, base, gap = max(9, round(17 * unit)), height - bar - round(13 * unit), round(18 * unit)
    right = width - gap
    for text in (caption.done, caption.note):
        if text:
            right -= _width(text, size, _SEMIBOLD)
            _text(picture, text, (right, base), size, _SEMIBOLD, _PALE if text == caption.note else _INK)
            right -= gap
    time = f"{caption.time:.1f} s"
    _text(picture, time, (gap, base), size, _SEMIBOLD, _INK)
    # Reserve the width of a long time, so that the following text does not jump.
    longest = f"{'0' * max(4, len(time) - 4)}.0 s"
    left = gap + _width(longest, size, _SEMIBOLD) + gap // 2
    for text, weight, colour in ((caption.node, _SEMIBOLD, _INK), (caption.message, _REGULAR, _PALE)):
        fitted = _fitted(text, size, weight, right - left)
        if fitted:
            _text(picture, fitted, (left, base), size, weight, colour)
            left += _width(fitted, size, weight) + gap // 2
    if caption.elapsed is not None:
        _progress(picture, caption.elapsed, caption.marks, bar)
    if caption.trouble is not None:
        _banner(picture, caption.trouble, unit, height - line - bar)


def _progress(picture: Picture, elapsed: float, marks: tuple[float, ...], bar: int) -> None:
    height, width = picture.shape[:2]
    picture[height - bar :] = (222, 226, 232)
    picture[height - bar :, : round(width * min(max(elapsed, 0.0), 1.0))] = _BAR
    for mark in marks:
        at = min(round(width * mark), width - 2)
        picture[height - bar :, at : at + max(2, bar // 2)] = _ALARM


def _banner(picture: Picture, trouble: CaptionFailure, unit: float, foot: int) -> None:
    gap = round(18 * unit)
    size, small = max(10, round(20 * unit)), max(9, round(16 * unit))
    space = picture.shape[1] - 4 * gap
    cause = _fitted(trouble.cause, size, _SEMIBOLD, space)
    message = _fitted(trouble.message, small, _REGULAR, space)
    wide = max(_width(cause, size, _SEMIBOLD), _width(message, small, _REGULAR)) + 2 * gap
    high = round(64 * unit) if message else round(40 * unit)
    top = foot - gap // 2 - high
    _veil(picture, (gap, top, wide, high), _ALARM, 0.92)
    _text(picture, cause, (2 * gap, top + round(27 * unit)), size, _SEMIBOLD, _PAPER)
    _text(picture, message, (2 * gap, top + round(51 * unit)), small, _REGULAR, _PAPER)


def _veil(picture: Picture, box: tuple[int, int, int, int], colour: Colour, share: float) -> None:
    x, y, width, height = box
    window = picture[y : y + height, x : x + width]
    window[:] = (window * (1 - share) + [c * share for c in colour]).astype("uint8")


def _text(picture: Picture, text: str, at: tuple[int, int], size: int, weight: int, colour: Colour) -> None:
    """Draw text. `at` is the left end of the base line, pixels."""
    if text:
        cv2.putText(picture, text, at, colour, _font(), size, weight)


def _width(text: str, size: int, weight: int) -> int:
    return cv2.getTextSize((0, 0), text, (0, 0), _font(), size, weight)[2] if text else 0


def _fitted(text: str, size: int, weight: int, space: int) -> str:
    """Return the text, cut where it is wider than `space` pixels; empty when almost nothing is left."""
    text = " ".join(text.split())
    if _width(text, size, weight) <= space:
        return text
    short, long = 0, len(text)
    while short < long:
        middle = (short + long + 1) // 2
        if _width(text[:middle] + "…", size, weight) <= space:
            short = middle
        else:
            long = middle - 1
    return text[:short].rstrip() + "…" if short > 3 else ""


def _font() -> cv2.FontFace:
    """Return the font that OpenCV includes (Rubik)."""
    return cv2.FontFace("sans")

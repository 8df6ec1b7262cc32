"""Packing of a report's data into its page: JSON and arrays of numbers, compressed, as base64.

    uint32 length of the JSON · JSON · arrays, each at the offset in the JSON

An array is `{"~": kind, "at": offset, "shape": [...]}` in the JSON; `src/unpacking.js` reads it back."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
import orjson
from numpy.typing import NDArray


class StringTable:
    """Numbers for texts in the order in which they come; the empty text is 0."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {"": 0}

    def number(self, text: str) -> int:
        return self._numbers.setdefault(text, len(self._numbers))

    def numbers(self, texts: Sequence[str]) -> NDArray[np.uint32]:
        return np.array([self.number(text) for text in texts], dtype=np.uint32)

    @property
    def texts(self) -> tuple[str, ...]:
        """Texts in the order of their numbers."""
        return tuple(self._numbers)


AnyArray: TypeAlias = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Quantised:
    """Numbers that the page receives as multiples of a step, in 32-bit floats; NaN stays NaN."""

    levels: NDArray[np.int32]
    """Multiples of `step`, (n, …); `NAN_LEVEL` for NaN."""
    step: float


Packable: TypeAlias = (
    "None | bool | int | float | str | AnyArray | Quantised | Iterable[Packable] | Mapping[str, Packable]"
)
"""JSON in which numpy arrays and `Quantised` may occur as values."""
_GZIP: Final = 31
"""Window bits that make zlib write the form of gzip."""
NAN_LEVEL: Final = -(2**31)
_ARRAY_TYPES: Final[Mapping[str, str]] = {
    "b": "u1", "u1": "u1", "i1": "i1", "u2": "u2", "i2": "i2", "u4": "u4", "i4": "i4", "f4": "f4", "f8": "f8",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Section:
    """Data of one panel of the page. With `{"empty": sentence}` the page shows the sentence."""

    name: str
    data: Packable


def quantise(values: AnyArray, step: float) -> Quantised:
    """Round `values` (n, …) to the nearest multiples of `step`. Raises ValueError beyond 31 bits."""
    with np.errstate(invalid="ignore"):
        levels = np.round(np.asarray(values, dtype=np.float64) / step)
    gaps = np.isnan(levels)
    if np.abs(levels[~gaps]).max(initial=0.0) >= -NAN_LEVEL:
        raise ValueError(f"a step of {step} is too fine for these numbers")
    return Quantised(np.where(gaps, NAN_LEVEL, levels).astype(np.int32), step)


def pack(sections: Iterable[Section]) -> str:
    """Return all sections as one line of base64. The arrays of one may be freed before the next is made."""
    blobs = _Blobs()
    head = orjson.dumps({section.name: blobs.plain(section.data) for section in sections})
    head += b" " * (-(len(head) + 4) % 8)  # arrays begin at multiples of 8
    deflate = zlib.compressobj(6, wbits=_GZIP)
    packed = [deflate.compress(part) for part in (struct.pack("<I", len(head)), head, *blobs.parts)]
    return base64.b64encode(b"".join((*packed, deflate.flush()))).decode("ascii")


class _Blobs:
    """Arrays of a report, one behind the other."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self._length = 0

    def plain(self, value: object) -> object:
        """Return `value` as plain JSON, and store its arrays."""
        match value:
            case None | bool() | int() | float() | str():
                return value
            case np.ndarray():
                return self._array(value)  # pyright: ignore[reportUnknownArgumentType]
            case Quantised():
                return self._quantised(value)
            case Mapping():
                return {str(key): self.plain(below) for key, below in value.items()}  # pyright: ignore
            case Iterable():  # an iterator makes one after the other, as they are stored
                return [self.plain(below) for below in value]  # pyright: ignore
            case np.generic():
                return value.item()  # pyright: ignore
            case _:
                raise TypeError(f"a report cannot hold a {type(value).__name__}")

    def _array(self, array: AnyArray) -> object:
        kind = _ARRAY_TYPES.get(array.dtype.str[1:]) or _ARRAY_TYPES.get(array.dtype.kind)
        if kind is None:
            raise TypeError(f"a report cannot hold an array of {array.dtype}")
        data = np.ascontiguousarray(array).astype("<" + kind).tobytes()
        return {"~": kind, "at": self._put(data), "shape": list(array.shape)}

    def _quantised(self, numbers: Quantised) -> object:
        """Store the numbers by column, as differences from row to row, all low bytes before all high ones.

        Values that change slowly or not at all then compress to almost nothing.
        """
        levels = numbers.levels
        rows = levels.reshape(len(levels), -1) if levels.size else levels.reshape(len(levels), 0)
        # 32-bit arithmetic wraps around, here and in the page.
        steps = np.diff(rows.T, axis=1, prepend=np.int32(0)).astype("<i4")
        largest = int(np.abs(steps, dtype=np.int64).max(initial=0))
        width = 1 if largest < 1 << 7 else 2 if largest < 1 << 15 else 4
        planes = steps.astype(f"<i{width}").ravel().view(np.uint8).reshape(-1, width).T
        return {
            "~": "steps",
            "at": self._put(planes.tobytes()),
            "shape": list(levels.shape),
            "width": width,
            "step": numbers.step,
        }

    def _put(self, data: bytes) -> int:
        at = self._length
        padded = data + bytes(-len(data) % 8)
        self.parts.append(padded)
        self._length += len(padded)
        return at

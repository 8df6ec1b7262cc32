"""What picktree uses of PyAV."""

from collections.abc import Iterator
from fractions import Fraction
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

class VideoFormat:
    name: str

class VideoFrame:
    pts: int | None
    time_base: Fraction
    width: int
    height: int
    format: VideoFormat
    @staticmethod
    def from_ndarray(array: NDArray[np.uint8], format: str = "rgb24") -> VideoFrame: ...
    def reformat(self, *, format: str, dst_colorspace: int | None = None) -> VideoFrame: ...
    def to_ndarray(self, *, format: str) -> NDArray[np.uint8]: ...

class Packet: ...

class VideoCodecContext:
    name: str
    color_primaries: int
    color_trc: int
    colorspace: int
    color_range: int

class VideoStream:
    width: int
    height: int
    pix_fmt: str | None
    gop_size: int
    frames: int
    duration: int | None
    time_base: Fraction
    average_rate: Fraction
    codec_context: VideoCodecContext
    def encode(self, frame: VideoFrame | None) -> list[Packet]: ...

class Streams:
    video: tuple[VideoStream, ...]

class Container:
    streams: Streams
    def __enter__(self) -> Container: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
    def add_stream(
        self, codec_name: str, rate: int, options: dict[str, str] | None = None
    ) -> VideoStream: ...
    def mux(self, packets: list[Packet]) -> None: ...
    def decode(self, *, video: int) -> Iterator[VideoFrame]: ...

def open(
    file: str, mode: str = "r", *, format: str | None = None, options: dict[str, str] | None = None
) -> Container: ...

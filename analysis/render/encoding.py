"""Encoding of images into a film: H.264 in MP4, which every browser plays, or GIF."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from ...logs.optional_libraries import optional_import
from .rasterizer import Picture

if TYPE_CHECKING:
    from av import VideoFrame
    from av.filter import Graph

_BT709_COLOURS = 1
_LIMITED_RANGE = 1
"""Numbers of H.273 for the usual colours of films: BT.709, and limited range with black at 16 and white at
235."""
_KEYFRAME_INTERVAL = 2.0
"""Interval between points at which playback of a film can start, s."""


def require_encoder() -> None:
    """Raise PicktreeError when the encoder's library is not installed."""
    with optional_import("video", "av", "A video"):
        import av  # noqa: F401 # pyright: ignore[reportUnusedImport]


def write_mp4(path: Path, pictures: Iterable[Picture], size: tuple[int, int], fps: int) -> int:
    """Write images (h, w, 3) with even sides, and return their number. Raises OSError."""
    import av

    count = 0
    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=fps, options={"crf": "21", "preset": "faster"})
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.gop_size = max(1, round(_KEYFRAME_INTERVAL * fps))
        # Set explicitly, because players guess differently.
        context = stream.codec_context
        context.color_primaries = context.color_trc = context.colorspace = _BT709_COLOURS
        context.color_range = _LIMITED_RANGE
        for count, picture in enumerate(pictures, 1):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(
                format="yuv420p", dst_colorspace=_BT709_COLOURS
            )
            _stamp(frame, count - 1, fps)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return count


def write_gif(
    path: Path, pictures: Iterable[Picture], size: tuple[int, int], fps: int, sample: Sequence[Picture]
) -> int:
    """Write images (h, w, 3) in 256 colours chosen from the images of `sample`, and return their number.

    Raises OSError.
    """
    import av
    from av.filter import Graph

    palette = _palette(sample)
    graph = Graph()
    source = graph.add_buffer(width=size[0], height=size[1], format="rgb24", time_base=Fraction(1, fps))
    colours = graph.add_buffer(width=16, height=16, format=palette.format.name, time_base=Fraction(1, fps))
    # An ordered pattern stays the same where the image does, so the file stays small.
    use = graph.add("paletteuse", "dither=bayer:bayer_scale=4:diff_mode=rectangle")
    sink = graph.add("buffersink")
    source.link_to(use, 0, 0)
    colours.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()

    count = 0
    with av.open(str(path), "w", format="gif") as container:
        stream = container.add_stream("gif", rate=fps)
        stream.width, stream.height = size
        stream.pix_fmt = "pal8"
        _stamp(palette, 0, fps)
        colours.push(palette)
        colours.push(None)
        for count, picture in enumerate(pictures, 1):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            _stamp(frame, count - 1, fps)
            source.push(frame)
            for reduced in _ready_frames(graph):
                container.mux(stream.encode(reduced))
        source.push(None)
        for reduced in _ready_frames(graph):
            container.mux(stream.encode(reduced))
        container.mux(stream.encode(None))
    return count


def _palette(sample: Sequence[Picture]) -> VideoFrame:
    """Return 256 colours as an image of 16 × 16."""
    import av
    from av.filter import Graph

    height, width = sample[0].shape[:2]
    graph = Graph()
    source = graph.add_buffer(width=width, height=height, format="rgb24", time_base=Fraction(1, 1))
    make = graph.add("palettegen", "reserve_transparent=1:stats_mode=full")
    sink = graph.add("buffersink")
    source.link_to(make)
    make.link_to(sink)
    graph.configure()
    for number, picture in enumerate(sample):
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        _stamp(frame, number, 1)
        source.push(frame)
    source.push(None)
    return _ready_frames(graph)[-1]


def _ready_frames(graph: Graph) -> list[VideoFrame]:
    """Return the frames that the graph has ready."""
    from av.error import BlockingIOError, EOFError

    ready: list[VideoFrame] = []
    while True:
        try:
            ready.append(graph.pull())
        except (BlockingIOError, EOFError):
            return ready


def _stamp(frame: VideoFrame, number: int, fps: int) -> None:
    frame.pts, frame.time_base = number, Fraction(1, fps)

"""Films of runs, from their logs alone, as MP4 or GIF."""

from __future__ import annotations

import math
import multiprocessing
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Final

import numpy as np

from picktree.files import PicktreeError, file_system
from picktree.logs import RunLog, log_records, optional_import

from .captions import write
from .frames import FrameContent, moments
from .rasterizer import Picture
from .scene_view import SceneRenderer, Show, bin_tints
from .viewpoint import VIEWS, PictureView

if TYPE_CHECKING:
    from av import VideoFrame
    from av.filter import Graph

_BT709_COLOURS = 1
_LIMITED_RANGE = 1
"""Numbers of H.273 for the usual colours of films: BT.709, and limited range with black at 16 and white at
235."""
_KEYFRAME_INTERVAL = 2.0
"""Interval between points at which playback of a film can start, s."""


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
    from av.error import BlockingIOError, EOFError

    ready: list[VideoFrame] = []
    while True:
        try:
            ready.append(graph.pull())
        except (BlockingIOError, EOFError):
            return ready


def _stamp(frame: VideoFrame, number: int, fps: int) -> None:
    frame.pts, frame.time_base = number, Fraction(1, fps)


_MAX_WAITING_FRAMES = 2
"""Maximum number of frames that wait at each process: no process is idle, and few frames are in memory."""


@dataclass(frozen=True, slots=True)
class FrameSetup:
    """Settings of all frames of a film."""

    robot: tuple[log_records.LinkMesh, ...]
    view: PictureView
    size: tuple[int, int]
    tints: dict[str, str]
    """Colour of a bin's items, by bin."""


class FrameWorkers:
    """Processes that draw frames; a context manager. With one process everything is drawn in the present
    one."""

    def __init__(self, setup: FrameSetup, processes: int) -> None:
        self._setup, self._count = setup, processes
        self._painters: list[tuple[BaseProcess, Connection]] = []

    def __enter__(self) -> FrameWorkers:
        if self._count > 1:
            # Spawned, because a fork would take over locks of libraries' threads.
            context = multiprocessing.get_context("spawn")
            for _ in range(self._count):
                ours, theirs = context.Pipe()
                process = context.Process(target=_draw_frames, args=(theirs, self._setup), daemon=True)
                process.start()
                theirs.close()
                self._painters.append((process, ours))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process, line in self._painters:
            line.close()
            if kind is not None:
                process.terminate()
        for process, _ in self._painters:
            process.join()
        self._painters.clear()

    def pictures(self, frames: Iterable[FrameContent]) -> Iterator[Picture]:
        """Yield RGB (h, w, 3) of each frame, in order. Raises PicktreeError when a process dies."""
        if not self._painters:
            scenery = _scenery(self._setup)
            for frame in frames:
                yield _draw_frame(scenery, frame)
            return
        waiting: deque[Connection] = deque()
        for number, frame in enumerate(frames):
            if len(waiting) == _MAX_WAITING_FRAMES * len(self._painters):
                yield self._received(waiting.popleft())
            line = self._painters[number % len(self._painters)][1]
            try:
                line.send(frame)
            except OSError:
                raise _dead_process_error() from None
            waiting.append(line)
        while waiting:
            yield self._received(waiting.popleft())

    def _received(self, line: Connection) -> Picture:
        width, height = self._setup.size
        try:
            data = line.recv_bytes()
        except (EOFError, OSError):
            raise _dead_process_error() from None
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)


def _dead_process_error() -> PicktreeError:
    return PicktreeError(
        "a process that draws frames has died; --processes 1 draws without further processes"
    )


def _draw_frames(line: Connection, setup: FrameSetup) -> None:
    """Draw received frames until the connection closes: the main function of a process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process decides
    scenery = _scenery(setup)
    try:
        while True:
            frame: FrameContent = line.recv()
            line.send_bytes(_draw_frame(scenery, frame).tobytes())
    except (EOFError, OSError):
        return


def _scenery(setup: FrameSetup) -> SceneRenderer:
    return SceneRenderer(setup.robot, setup.view, setup.size, setup.tints)


def _draw_frame(scenery: SceneRenderer, frame: FrameContent) -> Picture:
    picture = scenery.picture(frame.shown)
    write(picture, frame.caption)
    return picture


FILM_SUFFIXES: Final = (".mp4", ".gif")
FAILURE_DISPLAY_TIME = 2.0
"""Time for which a failure is shown, s of the film."""
_MAX_SINGLE_PROCESS_FRAMES = 60
"""Number of frames up to which further processes do not pay for their start."""
_PALETTE_IMAGES = 5
"""Number of images from which a GIF's colours are chosen."""


@dataclass(frozen=True, slots=True)
class FilmRequest:
    """Content and settings of a film. None means the default for the kind of file."""

    start: float | None = None
    """Start, simulated s; None: the beginning of the log, which is later than 0 for a resumed run."""
    end: float | None = None
    """End, simulated s; None: time of the last message."""
    speed: float = 1.0
    """Simulated seconds in a second of the film."""
    fps: int | None = None
    size: tuple[int, int] | None = None
    """Width and height, pixels."""
    view: PictureView = VIEWS["corner"]
    show: Show = "belief"
    processes: int = 1
    """Number of drawing processes; more than one needs a program whose main module may be imported again."""


@dataclass(frozen=True, slots=True)
class Film:
    path: Path
    frames: int
    fps: int
    size: tuple[int, int]
    bytes: int
    wall: float
    """Time to make the film, wall s."""

    @property
    def seconds(self) -> float:
        """Length of the film, s."""
        return self.frames / self.fps

    def to_text(self) -> str:
        return (
            f"{self.path}: {self.seconds:.1f} s, {self.frames} frames of {self.size[0]} × {self.size[1]}, "
            f"{self.bytes / 1e6:.1f} MB, made in {self.wall:.0f} s"
        )

    def to_json(self) -> dict[str, object]:
        return {**asdict(self), "path": str(self.path), "seconds": self.seconds, "size": list(self.size)}


def film(
    log: RunLog,
    output: Path,
    request: FilmRequest | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Film:
    """Make the film `output`, an .mp4 or .gif. `progress` receives the number of finished frames, and of all.

    When it is stopped, no file remains. Raises PicktreeError for an unknown kind of file, a span without an
    image, and where the file cannot be written.
    """
    began = time.monotonic()
    request = request or FilmRequest()
    ending = output.suffix.lower()
    if ending not in FILM_SUFFIXES:
        raise PicktreeError(f"{output}: a film is a file that ends in {' or '.join(FILM_SUFFIXES)}")
    with optional_import("video", "av", "A video"):
        import av  # noqa: F401 # pyright: ignore[reportUnusedImport]
    moving = ending == ".gif"
    fps = request.fps or (10 if moving else 20)
    size = request.size or ((640, 400) if moving else (960, 600))
    if not moving and (size[0] % 2 or size[1] % 2):
        raise PicktreeError(f"size {size[0]}x{size[1]}: the sides of an MP4 must be even")
    start, end = _span(log, request)
    count = max(1, round((end - start) / request.speed * fps))
    times = [min(start + k * request.speed / fps, end) for k in range(count)]

    def pictures(some: list[float], painters: FrameWorkers) -> Iterator[Picture]:
        hold, speed = FAILURE_DISPLAY_TIME * request.speed, request.speed
        frames = moments(log, some, (start, end), show=request.show, hold=hold, speed=speed, bar=True)
        return painters.pictures(frames)

    setup = FrameSetup(log.robot_model(), request.view, size, bin_tints(log))
    with file_system.whole([output], output) as (beside,):
        output.parent.mkdir(parents=True, exist_ok=True)
        beside.touch()
        with FrameWorkers(setup, request.processes if count > _MAX_SINGLE_PROCESS_FRAMES else 1) as painters:
            drawn = _with_progress(pictures(times, painters), count, progress)
            if moving:
                sample = list(
                    pictures(times[:: max(1, math.ceil(count / _PALETTE_IMAGES))], FrameWorkers(setup, 1))
                )
                frames = write_gif(beside, drawn, size, fps, sample)
            else:
                frames = write_mp4(beside, drawn, size, fps)
        written = beside.stat().st_size
    return Film(output, frames, fps, size, written, time.monotonic() - began)


def _span(log: RunLog, request: FilmRequest) -> tuple[float, float]:
    end = log.end if request.end is None else min(request.end, log.end)
    if not request.speed > 0:
        raise PicktreeError(f"speed {request.speed:g}: it must be more than 0")
    start = next((at.time for at in log.ticks()), 0.0) if request.start is None else request.start
    if start >= log.end:
        raise PicktreeError(
            f"{log.path}: the run lasted {log.end:.2f} s; there is nothing from {start:g} s on"
        )
    if start < 0 or start >= end:
        raise PicktreeError(f"from {start:g} s to {end:g} s there is nothing to film")
    return start, end


def _with_progress(
    pictures: Iterable[Picture], count: int, progress: Callable[[int, int], None] | None
) -> Iterator[Picture]:
    for number, picture in enumerate(pictures, 1):
        yield picture
        if progress is not None:
            progress(number, count)

"""A picture of one moment of a run, drawn from its log alone."""

from __future__ import annotations

from pathlib import Path

from ...errors import PicktreeError
from ...logs.recording.images import write_picture
from ...logs.run_log import RunLog
from .captions import write
from .frames import moments
from .rasterizer import Picture
from .scene_view import Scenery, Show
from .viewpoint import View

SIZE = (1280, 800)
_FINE = 2


def snapshot(
    log: RunLog | str | Path,
    at: float,
    output: Path,
    size: tuple[int, int] = SIZE,
    view: View | None = None,
    *,
    show: Show = "belief",
    caption: bool = True,
) -> None:
    """Draw the moment `at` (simulated seconds) into a PNG file.

    `belief` shows what the robot believes, `truth` the simulator's truth of the second before, `both` the
    belief with outlines of the truth. Raises PicktreeError when the log holds nothing of that moment or the
    picture cannot be written.
    """
    if isinstance(log, RunLog):
        picture = draw(log, at, size, view, show=show, caption=caption)
    else:
        with RunLog(log) as opened:
            picture = draw(opened, at, size, view, show=show, caption=caption)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        write_picture(str(output), picture)
    except OSError as error:
        raise PicktreeError(f"{output}: the picture cannot be written: {error}") from None


def draw(
    log: RunLog,
    at: float,
    size: tuple[int, int] = SIZE,
    view: View | None = None,
    *,
    show: Show = "belief",
    caption: bool = True,
) -> Picture:
    """The picture as RGB (h, w, 3)."""
    if not 0 <= at <= log.end + 1e-9:
        raise PicktreeError(f"{log.path}: the run lasted {log.end:.2f} s; there is no moment {at:g} s")
    (moment,) = moments(log, [at], (at, at), show=show)
    picture = Scenery(log.robot_model(), view or View(), size, fine=_FINE).single(moment.shown)
    if caption:
        write(picture, moment.caption)
    return picture

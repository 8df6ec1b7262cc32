"""A picture of one moment of a run, drawn from its log alone."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2

from ..world.colours import COLOURS
from ..world.errors import PicktreeError
from .glb import read_glb
from .images import write_picture
from .meshes import Mesh, joined, shape_mesh
from .messages import UNKNOWN_COLOUR
from .raster import Look, Picture, View, render
from .records import Scene
from .run_log import RunLog

SIZE = (1280, 800)


def snapshot(
    log: RunLog | str | Path,
    at: float,
    output: Path,
    size: tuple[int, int] = SIZE,
    view: View | None = None,
    *,
    show: Literal["belief", "truth"] = "belief",
    caption: bool = True,
) -> None:
    """Draw the moment `at` (simulated seconds) into a PNG file.

    `belief` shows what the robot believes, `truth` the simulator's truth of the second before. Raises
    PicktreeError when the log holds nothing of that moment or the picture cannot be written.
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
    show: Literal["belief", "truth"] = "belief",
    caption: bool = True,
) -> Picture:
    """The picture as RGB (h, w, 3)."""
    if not 0 <= at <= log.end + 1e-9:
        raise PicktreeError(f"{log.path}: the run lasted {log.end:.2f} s; there is no moment {at:g} s")
    scene = log.belief_at(at) if show == "belief" else log.truth_at(at)
    if scene is None:
        raise PicktreeError(f"{log.path}: the log holds no {show} at {at:g} s or before")
    picture = render(_everything(log, scene.record, at), view or View(), size, Look())
    if caption:
        _write(picture, _caption(log, at))
    return picture


def _everything(log: RunLog, scene: Scene, at: float) -> Mesh:
    frames = log.transforms_at(at)
    poses = {t.child: t.pose for t in frames.record} if frames is not None else {}
    parts = [read_glb(mesh.glb).placed(poses[mesh.link]) for mesh in log.robot_model() if mesh.link in poses]
    parts += [shape_mesh(p.shape, COLOURS.get(p.colour, UNKNOWN_COLOUR)).placed(p.pose) for p in scene.fixed]
    parts += [
        shape_mesh(b.shape, COLOURS.get(b.colour, UNKNOWN_COLOUR)).placed(poses.get(b.id, b.pose))
        for b in scene.bodies
    ]
    return joined(parts)


def _caption(log: RunLog, at: float) -> str:
    words = [f"{at:.1f} s"]
    tick = log.tick_at(at)
    if tick is not None and tick.record.tip:
        node = next(n for n in tick.record.nodes if n.path == tick.record.tip)
        words.append(f"{node.id}: {node.message}" if node.message else node.id)
    done = sum(1 for event in log.events(end=at) if event.record.kind == "item_done")
    if done:
        words.append(f"{done} item{'s' if done > 1 else ''} done")
    return "   |   ".join(words)


def _write(picture: Picture, text: str) -> None:
    """One line of text in the lower left corner, in place."""
    height = picture.shape[0]
    plain = text.encode("ascii", "replace").decode()
    origin = (round(height * 0.03), height - round(height * 0.03))
    scale = height / 1100
    cv2.putText(picture, plain, origin, cv2.FONT_HERSHEY_DUPLEX, scale, (60, 66, 77), 1, cv2.LINE_AA)

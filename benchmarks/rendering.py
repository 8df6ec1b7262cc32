"""What pictures and films of a log cost: processor time a frame, a still picture, a minute of film.

python benchmarks/rendering.py [LOG]      (without: a run of sort_by_colour is made first)
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from picktree.analysis.render import FilmRequest, PictureView, SceneRenderer, draw, film, write
from picktree.analysis.render.frames import moments
from picktree.logs import RunLog
from picktree.session import RunRequest, Session

MISSION = Path(__file__).parents[1] / "examples" / "sort_by_colour.yaml"
SIZE = (960, 600)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("log", nargs="?", help="log file or run folder")
    parser.add_argument("--runs", type=int, default=40, help="frames to draw")
    asked = parser.parse_args()
    frames: int = asked.runs
    print(
        f"{frames} frames of {SIZE[0]} × {SIZE[1]} and 3 s of film: {0.15 * frames + 20:.0f} s of processor"
    )
    with tempfile.TemporaryDirectory() as folder:
        where: str = asked.log or str(
            Session(RunRequest(mission=MISSION, backend="kinematic", out=Path(folder))).run().log
        )
        with RunLog(where) as log:
            _frames(log, frames)
            _cost("a still picture of 1280 × 800", lambda: draw(log, log.end / 2))
            output = Path(folder) / "film.mp4"
            span = FilmRequest(start=log.end / 3, end=log.end / 3 + 3.0)
            cost = _cost("3 s of film, 20 frames/s", lambda: film(log, output, span))
            print(f"  a minute of film: {cost * 20:.0f} s, {output.stat().st_size * 20 / 1e6:.1f} MB")


def _frames(log: RunLog, count: int) -> None:
    scenery = SceneRenderer(log.robot_model(), PictureView(), SIZE, {})
    times = [log.end * (k + 0.5) / count for k in range(count)]
    costs: list[float] = []
    for frame in moments(log, times, (0.0, log.end), bar=True):
        began = time.process_time()
        write(scenery.picture(frame.shown), frame.caption)
        costs.append(time.process_time() - began)
    ordered = sorted(costs[1:])
    median = statistics.median(ordered)
    print(f"a frame: median {median:.3f} s, slowest {ordered[-1]:.3f} s, the first {costs[0]:.2f} s")


def _cost(what: str, action: Callable[[], object]) -> float:
    began = time.process_time()
    action()
    spent = time.process_time() - began
    print(f"{what}: {spent:.2f} s")
    return spent


if __name__ == "__main__":
    main()

"""picktree video"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from ..terminal.output import keep_stdout


def snapshot(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    at: Annotated[float, typer.Option(metavar="SECONDS", min=0.0, help="Simulated time.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PICTURE", help="PNG file to write.")],
    size: Annotated[str, typer.Option(metavar="WxH", help="In pixels.")] = "1280x800",
    view: Annotated[
        str,
        typer.Option(
            metavar="VIEW",
            help="corner, front, left, right, top, close, or AZIMUTH,ELEVATION,DISTANCE (degrees, metres).",
        ),
    ] = "corner",
    show: Annotated[
        Literal["belief", "truth", "both"],
        typer.Option(help="What the robot believes, what is true, or both: the truth as outlines."),
    ] = "belief",
) -> None:
    """Draw the scene at one moment of a run, from its log alone."""
    from ...analysis.render.snapshot import snapshot as draw
    from ...analysis.render.viewpoint import parse_size, parse_view
    from ...logs.run_log import RunLog

    with RunLog(log) as opened:
        if opened.recovered:
            print(opened.recovered, file=sys.stderr)
        draw(opened, at, output, parse_size(size), parse_view(view), show=show)
    print(output)


def video(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILM", help="A .mp4 or .gif file.")],
    start: Annotated[float, typer.Option("--from", metavar="SECONDS", min=0.0, help="Simulated time.")] = 0.0,
    end: Annotated[
        float | None,
        typer.Option("--to", metavar="SECONDS", help="Simulated time.", show_default="the end of the run"),
    ] = None,
    speed: Annotated[
        float, typer.Option(metavar="TIMES", help="Simulated seconds in one of the film.")
    ] = 1.0,
    fps: Annotated[
        int | None, typer.Option(min=1, max=60, help="Frames in a second.", show_default="20, GIF 10")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="In pixels.", show_default="960x600, GIF 640x400")
    ] = None,
    view: Annotated[
        str,
        typer.Option(
            metavar="VIEW",
            help="corner, front, left, right, top, close, or AZIMUTH,ELEVATION,DISTANCE (degrees, metres).",
        ),
    ] = "corner",
    show: Annotated[
        Literal["belief", "truth", "both"],
        typer.Option(help="What the robot believes, what is true, or both: the truth as outlines."),
    ] = "belief",
    processes: Annotated[
        int | None,
        typer.Option(min=1, help="How many draw.", show_default="as processors, 4 at most"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was written as one JSON object.")] = False,
) -> None:
    """Make a film of a run, from its log alone, with what runs, what is done and what fails written in."""
    answer = keep_stdout() if json else None
    import json as encoding

    from ...analysis.render.film import FilmRequest, film
    from ...analysis.render.viewpoint import parse_size, parse_view
    from ...logs.recording.interrupts import Interrupts
    from ...logs.run_log import RunLog

    request = FilmRequest(
        start=start,
        end=end,
        speed=speed,
        fps=fps,
        size=parse_size(size) if size else None,
        view=parse_view(view),
        show=show,
        processes=processes or min(os.cpu_count() or 1, 4),
    )
    with Interrupts(), RunLog(log) as opened:
        if opened.recovered:
            print(opened.recovered, file=sys.stderr)
        made = film(opened, output, request, _progress() if sys.stderr.isatty() else None)
    if answer is None:
        print(made.to_text())
    else:
        with answer:
            answer.write(encoding.dumps(made.to_json(), ensure_ascii=False, indent=2) + "\n")


def _progress() -> Callable[[int, int], None]:
    """Return a function that shows progress and remaining time in one line of the terminal."""
    began = said = time.monotonic()

    def tell(done: int, count: int) -> None:
        nonlocal said
        now = time.monotonic()
        if done == count:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
        elif now - said > 0.3:
            said = now
            left = (now - began) / done * (count - done)
            text = f"frame {done} of {count}, {left:.0f} s left"
            print(f"\r{text}\033[K", end="", file=sys.stderr, flush=True)

    return tell

"""One run on one page: what each skill did when, what became of each item, the gripper and the wrist.

    python examples/analysis/timeline.py LOG [-o timeline.png]

LOG is a log file, a run's folder, or `last`. Needs `pip install 'picktree[analysis]'`.
"""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

import argparse
import math

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from picktree.analysis import Run

COLOURS = {"SUCCESS": "#4477aa", "FAILURE": "#cc3311", "HALTED": "#bbbbbb", "RUNNING": "#eecc66"}
LEAST = 0.004
"""Share of the run that a bar is drawn with at least, so that what took one tick is seen."""


def timeline(run: Run) -> Figure:
    skills, items = lanes_by_skill(run), lanes_by_item(run)
    heights = [len(skills), len(items), 2.6, 2.6]
    figure = Figure(figsize=(13, 1.6 + 0.3 * sum(heights)), layout="constrained", dpi=110)
    axes: list[Axes] = list(figure.subplots(4, 1, sharex=True, height_ratios=heights))
    figure.suptitle(title(run), x=0.01, ha="left", fontsize=11)
    draw_lanes(axes[0], skills, run.end)
    draw_lanes(axes[1], items, run.end, short=1)
    draw_gripper(axes[2], run)
    draw_wrist(axes[3], run)
    for axis in axes:
        for failure in run.failures:
            cured = failure.fate == "cured" or failure.made_good_at is not None
            axis.axvline(failure.time, color="#cc3311", lw=0.8, ls=":" if cured else "-", zorder=0)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    label_failures(axes[0], run)
    axes[-1].set_xlim(0, run.end)
    axes[-1].set_xlabel("simulated time, s")
    shown = [Patch(color=colour, label=outcome.lower()) for outcome, colour in COLOURS.items()]
    figure.legend(handles=shown, loc="lower left", ncols=len(shown), frameon=False, fontsize=8)
    return figure


def title(run: Run) -> str:
    outcome = run.explanation.outcome
    causes = [f"• {cause.title}" for cause in run.explanation.root_causes[:3]]
    return "\n".join([f"{run.info.mission}, {run.info.seed_text}: {outcome.sentence}", *causes])


Bar = tuple[float, float, str, str]
"""Start and end in s, outcome, and what is written on it."""


def lanes_by_skill(run: Run) -> dict[str, list[Bar]]:
    """By the name of each leaf that took time, in the order in which they first ran."""
    leaves = {node.path for at in run.trees for node in at.record.nodes if not node.children}
    lanes: dict[str, list[Bar]] = {}
    for visit in run.visits:
        if visit.path in leaves and (visit.duration > 0 or visit.failed_itself):
            lanes.setdefault(visit.id, []).append((visit.start, visit.end, visit.outcome, visit.item))
    return lanes


def lanes_by_item(run: Run) -> dict[str, list[Bar]]:
    """By item, in the order in which they were first handled; those never handled last."""
    leaves = {node.path for at in run.trees for node in at.record.nodes if not node.children}
    states = {story.id: story.state for story in run.items}
    lanes: dict[str, list[Bar]] = {}
    for visit in run.visits:
        if visit.item in states and visit.path in leaves and (visit.duration > 0 or visit.failed_itself):
            bar = (visit.start, visit.end, visit.outcome, visit.id)
            lanes.setdefault(f"{visit.item} ({states[visit.item]})", []).append(bar)
    for name, state in states.items():
        lanes.setdefault(f"{name} ({state})", [])
    return lanes


def draw_lanes(axis: Axes, lanes: dict[str, list[Bar]], end: float, short: int = 0) -> None:
    """Where a bar is too narrow for its text, the first `short` letters stand in it."""
    for row, bars in enumerate(lanes.values()):
        for start, stop, outcome, text in bars:
            width = max(stop - start, LEAST * end)
            colour = COLOURS.get(outcome, "#bbbbbb")
            axis.barh(row, width, left=start, height=0.72, color=colour, edgecolor="white", lw=0.5)
            written = text if width > 0.0058 * end * len(text) else text[:short]
            if written and width > 0.008 * end:
                place = (start + width / 2, row + 0.03)
                axis.text(*place, written, ha="center", va="center", color="white", fontsize=7)
    axis.set_yticks(range(len(lanes)), list(lanes), fontsize=8)
    axis.set_ylim(len(lanes) - 0.5, -0.5)
    axis.tick_params(length=0)


def label_failures(axis: Axes, run: Run) -> None:
    """Each cause above its line, unless it would stand on the one before."""
    last = -math.inf
    for failure in run.failures:
        if failure.time - last > 0.09 * run.end:
            place = (failure.time, -0.62)
            axis.text(*place, failure.cause, color="#cc3311", fontsize=7, ha="left", va="bottom")
            last = failure.time


def draw_gripper(axis: Axes, run: Run) -> None:
    gripper = run.gripper
    axis.plot(gripper.times, gripper.widths * 1000, color="#222222", lw=1.0)
    for pick in run.picks:
        marker, colour = ("o", "#4477aa") if pick.held else ("x", "#cc3311")
        axis.plot(pick.time, pick.width * 1000, marker, color=colour, ms=6)
    axis.set_ylabel("opening, mm\n(○ held, × not)", fontsize=8)


def draw_wrist(axis: Axes, run: Run) -> None:
    force = np.linalg.norm(run.wrenches.forces, axis=1)
    axis.plot(run.wrenches.times, force, color="#222222", lw=0.7)
    axis.set_ylabel("force at the\nwrist, N", fontsize=8)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", metavar="LOG")
    parser.add_argument("-o", "--output", default="timeline.png")
    asked = parser.parse_args()
    matplotlib.use("Agg")
    with Run(asked.log) as run:
        timeline(run).savefig(asked.output)
    print(asked.output)


if __name__ == "__main__":
    main()

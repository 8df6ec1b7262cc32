"""Analysed run: a recorded run with its explanation, failures, items and pictures."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from picktree.analysis.explain import Explanation, FailureStory, ItemStory
from picktree.logs import RunRecord


class Run(RunRecord):
    """Run, read from its log alone, also when it was cut off.

    `where` is a log file, a run's folder, or `last`. `truth`: the explanation uses the ground truth; None:
    where the log has it. Times are simulated seconds, lengths m, angles rad,
    forces N; poses are in the world. Everything is read on the first request, and then kept; `ticks` and
    `images` read each time, so that a long log needs little memory. Use it as a context manager, or `close`
    it.

    Raises PicktreeError when `where` is no log, or the file is damaged.

        with Run("runs/sort_by_colour-3-20261121-083249") as run:
            print(run)                            # mission, seed, duration, outcome
            for failure in run.failures:          # every failure, and its disposition
                print(failure.time, failure.cause, failure.item, failure.fate)
            moment = run.at(17.0)                 # tick, belief, truth, blackboard
            picture = run.picture(17.0)           # as an array, for imshow
    """

    def __init__(self, where: str | Path, *, truth: bool | None = None) -> None:
        super().__init__(where)
        self._truth = truth

    @cached_property
    def explanation(self) -> Explanation:
        """Explanation of the run's end: failures, root causes, items, places to look at."""
        from picktree.analysis.explain import explain  # most readers of a log explain nothing

        return explain(self, truth=self._truth)

    @property
    def failures(self) -> tuple[FailureStory, ...]:
        """Failures with a cause and their dispositions, in order of time."""
        return self.explanation.failures

    @property
    def items(self) -> tuple[ItemStory, ...]:
        """Stories of the items: events as the robot believed, and the true place at the end."""
        return self.explanation.items

    def picture(
        self,
        time: float,
        size: tuple[int, int] = (960, 600),
        *,
        view: str = "corner",
        show: Literal["belief", "truth", "both"] = "belief",
        caption: bool = True,
    ) -> NDArray[np.uint8]:
        """Return the scene at that time as RGB (h, w, 3).

        `size` is in pixels; `view` a name such as `top`, or `AZIMUTH,ELEVATION,DISTANCE` in degrees and m;
        `both` draws the belief with outlines of the truth. Raises PicktreeError for a time outside the run.
        """
        from picktree.analysis.render import (
            draw,  # slow to load
            parse_view,
        )

        return draw(self.log, time, size, parse_view(view), show=show, caption=caption)

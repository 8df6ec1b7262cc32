"""Report of a shadow run: a table of its set-points beside the log, lines for displays, and its end."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Final

from picktree.drivers import ShadowHardware, shadow_summary
from picktree.logs import RunResult
from picktree.world import Tick

from .execution import Execution
from .observer import Observer

TABLE_NAME: Final = "shadow.csv"
"""Name of the table in the run's folder."""
SHOWN_PERIOD: Final = 0.5
"""Time between two lines for displays, s."""


class ShadowReport(Observer):
    """Observer that reports a shadow, and interrupts the run where the prediction ends."""

    def __init__(self, show: Callable[[str], None]) -> None:
        """`show`: receiver of lines for displays."""
        self._show = show
        self._written = 0
        self._next = 0.0

    def started(self, run: Execution, folder: Path) -> None:
        assert isinstance(run.hardware, ShadowHardware)
        self._shadow = run.hardware
        self._table = (folder / TABLE_NAME).open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._table)
        names = (f"{joint.name} rad" for joint in self._shadow.link.robot.joints)
        self._rows.writerow(
            ["time s", *names, "joints rad", "tcp m", "force N", "torque Nm", "opening m"],
        )

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        for step in self._shadow.steps[self._written :]:
            off = (step.joints, step.tcp, step.force, step.torque, step.opening)
            self._rows.writerow(f"{value:.6g}" for value in (step.time, *step.position.tolist(), *off))
            if step.time >= self._next:
                self._next = step.time + SHOWN_PERIOD
                q = " ".join(f"{value:+.3f}" for value in step.position)
                self._show(
                    f"would send {q} rad; the robot is {step.joints:.3f} rad, {1000 * step.tcp:.1f} mm, "
                    f"{step.force:.2f} N, {1000 * step.opening:.1f} mm of opening away"
                )
        self._written = len(self._shadow.steps)
        if self._shadow.ended:
            raise KeyboardInterrupt(f"the shadow ends here: {self._shadow.ended}")

    def finished(self, result: RunResult) -> None:
        self._table.close()
        self._show(shadow_summary(self._shadow))

"""Silence of the sensors: violation of the safety monitor when a sensor gives no new reading."""

from __future__ import annotations

from ...world.causes import safety
from ...world.protocols import SensorStamps
from .stop_latch import Latch

JOINTS_SILENT = 0.05
"""Longest silence of the encoders, s: at full speed the arm goes 0.1 rad meanwhile, unseen."""
WRENCH_SILENT = 0.1
"""Of the wrist sensor, s: a guarded move goes 3 to 10 mm meanwhile, unfelt."""
GRIPPER_SILENT = 0.5
"""Of the gripper, s: grippers tell their opening some ten times a second; fingers are slow."""

STALE = safety.STALE_SENSOR.name
_SENSORS = (
    ("joints", "the encoders of the joints have", JOINTS_SILENT),
    ("gripper", "the gripper has", GRIPPER_SILENT),
    ("wrench", "the wrist sensor has", WRENCH_SILENT),
)


def check_silence(latch: Latch, now: float, stamps: SensorStamps, repeats_since: float | None) -> bool:
    """Report to `latch` which sensors are silent at `now`, s. False: none is, and the latch is not busy.

    `repeats_since`: time since which the noisy wrist sensor repeats its reading exactly, s; None: it varies.
    """
    repeating = repeats_since is not None and now - repeats_since > WRENCH_SILENT
    if (
        now - stamps.joints <= JOINTS_SILENT
        and now - stamps.wrench <= WRENCH_SILENT
        and now - stamps.gripper <= GRIPPER_SILENT
        and not repeating
        and not latch.busy
    ):
        return False
    for (sensor, words, longest), stamp in zip(
        _SENSORS, (stamps.joints, stamps.gripper, stamps.wrench), strict=True
    ):
        name, what, since = f"{STALE}/{sensor}", "given no new reading", stamp
        if sensor == "wrench" and repeating and repeats_since is not None and repeats_since < stamp:
            what, since = "repeated itself bit by bit", repeats_since
        if now - since > longest:
            message = f"{words} {what} since {since:.2f} s"
            latch.violated(
                name, safety.STALE_SENSOR, 1.0, 0.0, message, sensor=sensor, since=since, longest=longest
            )
        elif latch.busy:
            latch.within(name, 1.0, 0.0)
    return True

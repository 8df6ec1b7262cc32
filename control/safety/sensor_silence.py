"""Silence of the sensors: a violation when a sensor gives no new reading."""

from __future__ import annotations

from ...world.causes import safety
from ...world.protocols import SensorStamps
from .stop_latch import Latch

JOINTS_SILENT = 0.05
"""Longest silence of the encoders, s. At full speed the arm moves 0.1 rad in that time."""
WRENCH_SILENT = 0.1
"""Longest silence of the wrist sensor, s. A guarded move travels 3 to 10 mm in that time."""
GRIPPER_SILENT = 0.5
"""Longest silence of the gripper, s. Grippers send their opening some ten times a second; fingers are
slow."""

STALE = safety.STALE_SENSOR.name
_SENSORS = (
    ("joints", "the encoders of the joints have", JOINTS_SILENT),
    ("gripper", "the gripper has", GRIPPER_SILENT),
    ("wrench", "the wrist sensor has", WRENCH_SILENT),
)


def check_silence(latch: Latch, now: float, stamps: SensorStamps, repeats_since: float | None) -> bool:
    """Report silent sensors at `now`, s, to the latch. Returns False when none is silent and the latch is not
    busy.

    `repeats_since`: time since which the noisy wrist sensor repeats its reading exactly, s. None: it does
    not.
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

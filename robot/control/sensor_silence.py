"""Silence of the sensors: a violation when a sensor gives no new reading."""

from __future__ import annotations

from ...world.causes import safety
from ...world.protocols import SensorStamps
from .stop_latch import Latch

MAX_JOINTS_SILENCE = 0.05
"""Longest silence of the encoders, s. At full speed the arm moves 0.1 rad in that time."""
MAX_WRENCH_SILENCE = 0.1
"""Longest silence of the wrist sensor, s. A guarded move travels 3 to 10 mm in that time."""
MAX_GRIPPER_SILENCE = 0.5
"""Longest silence of the gripper, s. Grippers send their opening some ten times a second; fingers are
slow."""

STALE_SENSOR_NAME = safety.STALE_SENSOR.name
_SENSORS = (
    ("joints", "the encoders of the joints have", MAX_JOINTS_SILENCE),
    ("gripper", "the gripper has", MAX_GRIPPER_SILENCE),
    ("wrench", "the wrist sensor has", MAX_WRENCH_SILENCE),
)


def check_silence(latch: Latch, now: float, stamps: SensorStamps, repeats_since: float | None) -> bool:
    """Report silent sensors at `now`, s, to the latch. Returns False when none is silent and the latch is not
    busy.

    `repeats_since`: time since which the noisy wrist sensor repeats its reading exactly, s. None: it does
    not.
    """
    repeating = repeats_since is not None and now - repeats_since > MAX_WRENCH_SILENCE
    if (
        now - stamps.joints <= MAX_JOINTS_SILENCE
        and now - stamps.wrench <= MAX_WRENCH_SILENCE
        and now - stamps.gripper <= MAX_GRIPPER_SILENCE
        and not repeating
        and not latch.busy
    ):
        return False
    for (sensor, words, longest), stamp in zip(
        _SENSORS, (stamps.joints, stamps.gripper, stamps.wrench), strict=True
    ):
        name, what, since = f"{STALE_SENSOR_NAME}/{sensor}", "given no new reading", stamp
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

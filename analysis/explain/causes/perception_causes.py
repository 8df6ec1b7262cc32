"""Errors of seeing: a camera that hangs elsewhere than believed, items taken for others, items never seen."""

from __future__ import annotations

import numpy as np

from ....files.value_wording import listed
from ....logs.schema.event_records import ImageEvent
from ....logs.schema.records import BodyRecord
from ....world.scene.description import CameraDescription
from ..investigation.case import Finding, Investigation
from ..investigation.explanation import FailureStory
from ..investigation.number_wording import counted, distance, place

OFF = 0.005
"""A mean offset of belief from truth beyond this is the camera's, m."""
ALIKE = 0.5
"""Share of the mean by which the offsets of single items may scatter."""
FEWEST = 2
"""Items whose offsets tell of the camera."""
AFFECTED = frozenset(
    {
        "grasp.missed", "grasp.slipped", "grasp.no_candidate", "world.disturbed", "world.unknown_object",
        "safety.force_limit", "safety.stop", "planning.start_in_collision", "control.tracking",
        "control.timeout", "place.missed",
    }
)  # fmt: skip
"""Causes that a wrong place of an item may have."""


def camera_off(case: Investigation) -> Finding | None:
    """Whether all items were seen off by the same way, which is the camera's fault, not theirs."""
    offsets: dict[str, tuple[float, float]] = {}
    for item, true in case.pairs.items():
        track = case.belief.tracks[item]
        seen = track.first
        body = case.truth.tracks[true].before(track.times[0])
        if body is not None and not seen.attached:
            offsets[item] = (
                body.pose.position[0] - seen.pose.position[0],
                body.pose.position[1] - seen.pose.position[1],
            )
    if len(offsets) < FEWEST:
        return None
    ways = np.array(list(offsets.values()))
    mean = np.median(ways, axis=0)
    size = float(np.linalg.norm(mean))
    scatter = float(np.median(np.linalg.norm(ways - mean, axis=1)))
    if size < OFF or scatter > ALIKE * size:
        return None
    name = _camera(case)
    title = (
        f"everything is believed {distance(size)} from where it is: "
        f"{name} hangs elsewhere than believed, or is turned"
    )
    reasons = (
        f"{counted(len(offsets), 'item')} lay {distance(abs(float(mean[0])))} in x and "
        f"{distance(abs(float(mean[1])))} in y from where {'they were' if len(offsets) > 1 else 'it was'} "
        f"first seen, in the same direction ({listed(sorted(offsets), 4)})",
    )
    return Finding("camera.off", name, title, reasons, "", 0.0)


def through_the_camera(finding: Finding | None, failure: FailureStory) -> Finding | None:
    """The camera's fault as the reason of a failure that it may have led to."""
    return finding if finding is not None and failure.cause in AFFECTED else None


def never_seen(case: Investigation, true: str) -> Finding:
    """For a true item that no belief ever was of."""
    body = case.truth.tracks[true].first
    cameras = [c for c in case.scene.cameras if c.on == "world"] if case.scene else []
    views = [f"it lies outside the picture of {c.name}" for c in cameras if not in_picture(c, body)]
    hidden = [f"it lies within the picture of {c.name}, hidden or not recognised" for c in cameras]
    looks = len(case.events(ImageEvent))
    title = f"{case.name_of(true)} was never seen: it lies at {place(body.pose.position)}"
    reasons = (*(views or hidden), f"the robot looked {counted(looks, 'time')}")
    return Finding("item.never_seen", true, title, reasons, true, None)


def in_picture(camera: CameraDescription, body: BodyRecord) -> bool:
    """Whether the body's centre is within the picture, as far as the camera hangs where it is believed to."""
    x, y, z = (camera.pose.inverse() @ body.pose).position
    width, height = camera.size
    if z <= 0.0:
        return False
    across = np.tan(camera.fov / 2)
    return bool(abs(y / z) <= across and abs(x / z) <= across * width / height)


def _camera(case: Investigation) -> str:
    looked = [str(at.record.message).removeprefix("image from ") for at in case.events(ImageEvent)]
    return f"the camera {looked[0]}" if looked else "the camera"

"""Events of skills and motions: grasps, placed items, pushes, safety stops, calibration images."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from .journal import JournalEvent

ObjectOf: TypeAlias = Annotated[str, "id of the object in the belief"]


class PickEvent(JournalEvent, kind="pick"):
    """The fingers closed on an object."""

    object: ObjectOf
    form: Annotated[str, "form of the object"] = ""
    candidate: Annotated[str, "name of the chosen grasp"] = ""
    held: Annotated[bool, "whether the hand then held it"]
    first_try: Annotated[bool | None, "whether it was the first try at this object"] = None
    width: Annotated[float | None, "opening after closing", "m"] = None
    load: Annotated[float | None, "weight at the wrist after lifting", "N"] = None
    force: Annotated[float | None, "force of each finger", "N"] = None


class PresentEvent(JournalEvent, kind="present"):
    """A thing in the hand was looked at from near."""

    object: ObjectOf
    whole: Annotated[bool, "whether it was seen from both sides of the hand"]
    colours: Annotated[tuple[str, ...], "colours of its surface, the largest first"] = ()
    tags: Annotated[tuple[str, ...], "numbers of the ArUco tags that were read on it"] = ()
    size: Annotated[float | None, "greatest distance of two seen points", "m"] = None
    mass: Annotated[float | None, "mass as it was weighed in the hand", "kg"] = None


class RegraspEvent(JournalEvent, kind="regrasp"):
    """An object is grasped once more."""

    object: ObjectOf
    where: Annotated[str, "place of the further grasp"]


class CentredEvent(JournalEvent, kind="centred"):
    """The hand gave way during closing until both fingers touched."""

    way: Annotated[float, "motion of the hand along the closing direction", "m"]
    aside: Annotated[float, "offset of the object between the fingers", "m"]
    width: Annotated[float, "opening after closing", "m"]


class SlipEvent(JournalEvent, kind="slip"):
    """The held object slips, and the fingers press more."""

    force: Annotated[float, "force of each finger from now on", "N"]
    before: Annotated[float, "force of each finger before", "N"]
    felt: Annotated[float, "mass that the wrist measures", "kg"]
    mass: Annotated[float, "mass of the payload", "kg"]


class ServoEvent(JournalEvent, kind="servo"):
    """The hand camera looked at an object or a hole just before contact."""

    hole: Annotated[str | None, "id of the hole"] = None
    object: Annotated[str | None, "id of the object in the belief"] = None
    off: Annotated[float | None, "distance of the hole from its believed pose", "m"] = None
    distance: Annotated[float | None, "distance of the object from its believed pose", "m"] = None
    turn: Annotated[float | None, "angle to the believed pose", "rad"] = None
    agreement: Annotated[float | None, "share of the hole's rim that the image shows, 0 … 1"] = None
    others: Annotated[int | None, "number of other objects that were recognised"] = None
    misfit: Annotated[float | None, "residual of the recognised object"] = None


class ReplannedEvent(JournalEvent, kind="replanned"):
    """The arm stopped for a change on its path, and planned again."""

    object: ObjectOf
    cause: Annotated[str, "cause of the stop"]
    why: Annotated[str, "message of the cause"]
    by: Annotated[tuple[str, ...], "contacts with obstacles, or their ids"]
    time: Annotated[int, "number of the replanning"]
    most: Annotated[int, "maximum number of replannings"]


class ItemDoneEvent(JournalEvent, kind="item_done"):
    """An object is placed or inserted, as the robot believes."""

    object: ObjectOf
    form: Annotated[str, "form of the object"] = ""
    into: Annotated[str | None, "id of the bin or hole; empty for a point"] = None
    spot: Annotated[str | None, "spot of the bin, or `point`"] = None
    depth: Annotated[float | None, "depth of insertion", "m"] = None
    force: Annotated[float | None, "greatest force during insertion", "N"] = None
    seconds: Annotated[float | None, "duration of the insertion", "s"] = None
    found_by: Annotated[str | None, "search that found the hole"] = None


class PutDownEvent(JournalEvent, kind="put_down"):
    """The held object is put down at a free place."""

    object: ObjectOf


class SetAsideEvent(JournalEvent, kind="set_aside"):
    """An item is given up at its place."""

    object: ObjectOf
    form: Annotated[str, "form of the object"] = ""
    x: Annotated[float | None, "x of the object in the world", "m"] = None
    y: Annotated[float | None, "y of the object in the world", "m"] = None
    times: Annotated[int | None, "number of times that it was given up"] = None


class PushEvent(JournalEvent, kind="push"):
    """An object was pushed."""

    object: ObjectOf
    form: Annotated[str | None, "form of the object"] = None
    off: Annotated[float | None, "distance to the goal", "m"] = None
    turned: Annotated[float | None, "angle to the goal", "rad"] = None
    strokes: Annotated[tuple[str, ...], "names of the strokes"] = ()


class BinEmptiedEvent(JournalEvent, kind="bin_emptied"):
    """The robot has noticed that a bin was exchanged, and forgets the objects in it."""

    bin: Annotated[str, "id of the bin"]
    objects: Annotated[tuple[str, ...], "ids of the forgotten objects"]


class GripperResetEvent(JournalEvent, kind="gripper_reset"):
    """The fingers follow again."""


class TookStockEvent(JournalEvent, kind="took_stock"):
    """The robot looked at the cell before it resumed without a checkpoint."""

    failed: Annotated[str | None, "cause of a step that failed"] = None
    width: Annotated[float | None, "opening of the hand", "m"] = None
    load: Annotated[float | None, "weight at the wrist", "N"] = None
    held: Annotated[bool | None, "whether the hand holds something"] = None
    camera: Annotated[str | None, "camera without an image"] = None
    done: Annotated[tuple[str, ...] | None, "ids of the items that are done"] = None
    gone: Annotated[tuple[str, ...] | None, "ids of the items that are seen nowhere"] = None
    items_done: Annotated[int | None, "number of items done"] = None


class SafetyStopEvent(JournalEvent, kind="safety_stop"):
    """The safety monitor latched a stop. The evidence of the cause is recorded beside the fields."""

    cause: Annotated[str, "cause of the stop"]


class SafetyAcknowledgedEvent(JournalEvent, kind="safety_acknowledged"):
    """A latched stop was acknowledged."""


class GaveWayEvent(JournalEvent, kind="gave_way"):
    """The arm gave way to a contact during a retreat."""

    left: Annotated[float, "force that is left", "N"]


class WristBiasEvent(JournalEvent, kind="wrist_bias"):
    """The bias of the wrist sensor has jumped, and is learnt again."""

    force: Annotated[float, "change of the bias", "N"]


class FramesMissedEvent(JournalEvent, kind="frames_missed"):
    """A camera delivered an image after missing frames."""

    missed: Annotated[int, "number of missing frames"]


class CalibrationShotEvent(JournalEvent, kind="calibration_shot"):
    """A camera saw the calibration target. Poses are position (m) and quaternion xyzw."""

    camera: Annotated[str, "name of the camera"]
    on_hand: Annotated[bool, "whether the hand carries it"]
    intrinsics: Annotated[tuple[float, ...], "width, height, fx, fy, cx, cy", "pixels"]
    tcp: Annotated[tuple[float, ...], "pose of the TCP in the world"]
    believed: Annotated[tuple[float, ...], "believed pose of the optical frame"]
    tiles: Annotated[tuple[tuple[float, ...], ...], "squares of the target, as detected"]


class CalibrationTouchEvent(JournalEvent, kind="calibration_touch"):
    """The closed fingers touched the calibration target."""

    face: Annotated[tuple[float, ...], "normal of the touched face in the target's frame"]
    tcp: Annotated[tuple[float, ...], "pose of the TCP in the world: position (m) and quaternion xyzw"]
    force: Annotated[float, "contact force", "N"]
    name: Annotated[str, "name of the touch"] = ""


class CalibrationSkippedEvent(JournalEvent, kind="calibration_skipped"):
    """A view or a touch of the calibration target was skipped."""

"""Events that the journal notes, one class for each kind, for trees, runs, skills and motions; and the
way from recorded values to an event.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias

from .journal import EVENT_KINDS, JournalEvent, OtherEvent, Plain


class RecoveryEvent(JournalEvent, kind="recovery"):
    """A recovery node runs a handler against a failure."""

    cause: Annotated[str, "cause of the failure"]
    failed: Annotated[str, "path of the node that failed"] = ""
    reason: Annotated[str, "message of the failure"] = ""
    handler: Annotated[str, "name of the handler"] = ""
    attempt: Annotated[int, "number of the branch's failed runs so far"] = 1
    ends: Annotated[bool, "whether the handler is done instead of the branch, which is not tried again"] = (
        False
    )


End: TypeAlias = Literal["cured", "done_instead", "given_up", "unhandled", "open"]
"""End of an episode; see `logs.item_episodes`."""
Fate: TypeAlias = Literal["cured", "done_instead", "passed_over", "branched", "ended", "open"]
"""Outcome of a single failure; it follows from the end of its episode.

`cured`, `done_instead` and `open`: as its episode. The reaction of the mission decides for an episode that
was given up or unhandled. `passed_over`: a loop continued with the next item. `branched`: a Fallback or
another node took another branch. `ended`: the failure reached the root and ended the mission.
"""


class FailureDecidedEvent(JournalEvent, kind="failure_decided"):
    """The outcome of a failure of `node` is decided."""

    cause: Annotated[str, "cause of the failure"]
    time: Annotated[float, "time of the failure, simulated", "s"]
    fate: Annotated[Fate, "outcome: cured, done_instead, passed_over, branched, ended or open"]
    by: Annotated[str, "path of the node that decided the outcome; empty when open"]


class EpisodeEvent(JournalEvent, kind="episode"):
    """An episode is decided: one cause from its first failure, at `node`, to the decision about it."""

    cause: Annotated[str, "cause of its failures"]
    item: Annotated[str, "object that the failure concerns; empty when unknown"]
    times: Annotated[tuple[float, ...], "times of its failures, simulated", "s"]
    end: Annotated[End, "outcome: cured, done_instead, given_up, unhandled or open"]
    ended: Annotated[float, "time of the decision, simulated", "s"]
    by: Annotated[str, "path of the node that handled it last; empty when none did"]
    handler: Annotated[str, "name of the last cure in that node: the pattern of `when`, `otherwise`, …"]
    tried: Annotated[tuple[str, ...], "names of the cures that ran, in order"]
    tries: Annotated[int, "number of runs after the failure that could succeed"]
    seconds: Annotated[float, "simulated time lost", "s"]

    @property
    def time(self) -> float:
        """Time of the first failure, simulated s."""
        return self.times[0]

    @property
    def cure(self) -> str:
        """Name of the last cure; empty when nothing was tried."""
        return self.tried[-1] if self.tried else ""

    @property
    def failed_before(self) -> tuple[str, ...]:
        """Names of the other cures that ran before the last one and failed, each once."""
        return tuple(name for name in dict.fromkeys(self.tried) if name != self.cure)


class FaultOutcomeEvent(JournalEvent, kind="fault_outcome"):
    """The first failure after an injected fault is decided, or none came; for the analyst only."""

    fault: Annotated[str, "kind of the fault"]
    time: Annotated[float, "time of the fault, simulated", "s"]
    item: Annotated[str, "id of the item in the simulation; empty when the fault concerns no item"]
    cause: Annotated[str, "cause of the first failure after the fault; empty when none came"]
    after: Annotated[float | None, "time from the fault to that failure, simulated", "s"] = None
    end: Annotated[End | None, "end of that failure's episode"] = None


class BudgetEvent(JournalEvent, kind="budget"):
    """The budget of a recovery is used up."""

    cause: Annotated[str, "cause of the failure"]
    failed: Annotated[str, "path of the node that failed"]
    object: Annotated[str, "object of the budget; empty for a budget over all objects"]
    tries: Annotated[int, "number of handlers that ran"]
    seconds: Annotated[float, "simulated time spent", "s"]


class HandledEvent(JournalEvent, kind="handled"):
    """A loop passes an element over whose body failed."""

    cause: Annotated[str | None, "cause of the failure; null for a false condition"]
    by: Annotated[str, "type of the loop"]
    element: Annotated[Plain, "element that is passed over"]
    failed: Annotated[str, "path of the node that failed"]


class LogEvent(JournalEvent, kind="log"):
    """A node `Log` was ticked."""

    value: Annotated[Plain, "logged value"]


class StepEvent(JournalEvent, kind="step"):
    """A step of a skill has ended, such as the closing of the fingers within a grasp."""

    step: Annotated[str, "name of the step"]
    start: Annotated[float, "start of the step, simulated", "s"]
    outcome: Annotated[str, "`success`, `failure` or `halted`"] = "success"
    cause: Annotated[str, "cause of a failure; else empty"] = ""


class PostconditionFailedEvent(JournalEvent, kind="postcondition_failed"):
    """A node succeeded, but its postcondition does not hold."""

    cause: Annotated[str, "cause of the failure"]


class UndeclaredCauseEvent(JournalEvent, kind="undeclared_cause"):
    """A node failed with a cause that it does not declare."""

    cause: Annotated[str, "cause of the failure"]


class InternalErrorEvent(JournalEvent, kind="internal_error"):
    """The code of a node raised an exception."""

    traceback: Annotated[str | None, "traceback of the exception"] = None


class HelpWantedEvent(JournalEvent, kind="help_wanted"):
    """A node requests a decision of the operator."""

    reason: Annotated[str, "question"]
    choices: Annotated[tuple[str, ...], "possible answers"]
    object: Annotated[str, "id of the object that the request concerns"]
    situation: Annotated[str, "situation in the robot's belief"]


class OperatorAnswerEvent(JournalEvent, kind="operator_answer"):
    """The operator answered."""

    question: Annotated[str, "question"]
    answer: Annotated[str, "answer"]


class BlackboardSetEvent(JournalEvent, kind="blackboard_set"):
    """The operator changed an entry of the blackboard."""

    key: Annotated[str, "full key of the entry"]
    value: Annotated[Plain, "value from now on"]
    previous: Annotated[Plain, "value before; null when nothing was written there"]
    passes: Annotated[int, "number of starts and ends of nodes in the tick before the change"]


class CheckpointEvent(JournalEvent, kind="checkpoint"):
    """The session took a checkpoint."""

    items_done: Annotated[int, "number of items done"]


class MissionChangedEvent(JournalEvent, kind="mission_changed"):
    """The run resumed with another mission."""

    fresh: Annotated[tuple[str, ...], "paths of the nodes without a previous state"]
    gone: Annotated[tuple[str, ...], "paths of the nodes that no longer exist"]


class MissionEditedEvent(JournalEvent, kind="mission_edited"):
    """An edited mission took over during the run."""

    files: Annotated[str, "folder of the edited files among the attachments"]
    fresh: Annotated[tuple[str, ...], "paths of the nodes without a previous state"]
    gone: Annotated[tuple[str, ...], "paths of the nodes that no longer exist"]


class DeliveryEvent(JournalEvent, kind="delivery"):
    """The feed put a load of items into the cell."""

    feed: Annotated[int, "number of the feed's entry in the scene"]
    number: Annotated[int, "number of the load"]
    items: Annotated[int, "number of items"]
    waiting: Annotated[int, "number of items without room yet"]


class BeltRunsEvent(JournalEvent, kind="belt_runs"):
    """A belt starts."""

    feed: Annotated[int, "number of the feed's entry in the scene"]
    belt: Annotated[str, "id of the belt"]
    number: Annotated[int, "number of the run"]


class BeltStopsEvent(JournalEvent, kind="belt_stops"):
    """A belt stops."""

    feed: Annotated[int, "number of the feed's entry in the scene"]
    belt: Annotated[str, "id of the belt"]
    number: Annotated[int, "number of the run"]
    items: Annotated[int, "number of items on the belt"]


class BinExchangedEvent(JournalEvent, kind="bin_exchanged"):
    """A bin was exchanged for an empty one."""

    bin: Annotated[str, "id of the bin"]
    items: Annotated[int, "number of items that left with the bin"]
    number: Annotated[int, "number of the exchange"]
    by: Annotated[str | None, "`person` when a person exchanges the scene's bins"] = None


class CrushedEvent(JournalEvent, kind="crushed"):
    """A finger pressed an item harder than it bears; ground truth."""

    object: Annotated[str, "id of the item in the simulation"]
    finger: Annotated[str, "name of the finger"]
    force: Annotated[float, "force of the finger", "N"]
    limit: Annotated[float, "greatest force that the item can withstand", "N"]
    time: Annotated[float, "simulated time of the contact", "s"]


_ITEM_LAST = ("appear", "slip")
"""Faults whose item is recorded behind their parameters."""


class FaultEvent(JournalEvent, kind="fault"):
    """A fault was injected, waits, or has ended. Its parameters are recorded beside the fields.

    A recorded null of `item` or `skill` means that the fault found nothing to act on.
    """

    fault: Annotated[str, "kind of the fault"]
    item: Annotated[str | None, "id of the item in the simulation"] = None
    obstacle: Annotated[str | None, "id of the obstacle"] = None
    skill: Annotated[str | None, "path of the skill"] = None
    waits: Annotated[bool | None, "true: the item waits until its place is free"] = None
    gone: Annotated[bool | None, "true: it has ended"] = None

    @property
    def data(self) -> dict[str, object]:
        item = {} if self.item is None else {"item": self.item}
        body = {"obstacle": self.obstacle, "skill": self.skill}
        end = {"waits": self.waits, "gone": self.gone}
        last = self.fault in _ITEM_LAST
        return {
            "fault": self.fault,
            **({} if last else item),
            **{name: value for name, value in body.items() if value is not None},
            **self.extra,
            **(item if last else {}),
            **{name: value for name, value in end.items() if value is not None},
        }

    @property
    def struck(self) -> bool:
        """Whether the fault acted on the cell with this event."""
        return not self.waits and not self.gone

    @property
    def missed(self) -> bool:
        """Whether the fault found no item to act on."""
        return "item" in self.extra


ObjectOf: TypeAlias = Annotated[str, "id of the object in the belief"]


class PickEvent(JournalEvent, kind="pick"):
    """The fingers closed on an object."""

    object: ObjectOf
    form: Annotated[str, "form of the object"] = ""
    candidate: Annotated[str, "name of the chosen grasp"] = ""
    held: Annotated[bool, "whether the hand then held the object"]
    first_try: Annotated[bool | None, "whether it was the first try at this object"] = None
    width: Annotated[float | None, "opening after closing", "m"] = None
    load: Annotated[float | None, "weight at the wrist after lifting", "N"] = None
    force: Annotated[float | None, "force of each finger", "N"] = None


class PresentEvent(JournalEvent, kind="present"):
    """A thing in the hand was looked at from near."""

    object: ObjectOf
    whole: Annotated[bool, "whether the camera saw the object from both sides of the hand"]
    colours: Annotated[tuple[str, ...], "colours of its surface, the largest first"] = ()
    tags: Annotated[tuple[str, ...], "numbers of the ArUco tags that were read on it"] = ()
    size: Annotated[float | None, "greatest distance of two seen points", "m"] = None
    mass: Annotated[float | None, "mass weighed in the hand", "kg"] = None


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
    on_hand: Annotated[bool, "whether the hand carries the camera"]
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


def event_of(kind: str, message: str, node: str, data: Mapping[str, object]) -> JournalEvent:
    """Return the event of a kind by its name and recorded values, as a log or a plug-in has them."""
    declared = EVENT_KINDS.get(kind)
    if declared is not None:
        try:
            return declared.from_data(message, node, data)
        except ValueError:
            pass
    return OtherEvent(message, node, name=kind, extra=data)

"""Events of trees and runs: recovery, operator, checkpoints, the feed of items, injected faults."""

from __future__ import annotations

from typing import Annotated

from .journal import JournalEvent, Plain


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


class CuredEvent(JournalEvent, kind="cured"):
    """A branch succeeded after handlers had run."""

    cause: Annotated[str, "cause of the last failure"]
    failed: Annotated[str, "path of the node that failed"] = ""
    tries: Annotated[int, "number of failures before"] = 1


class BudgetEvent(JournalEvent, kind="budget"):
    """The budget of a recovery is used up."""

    cause: Annotated[str, "cause of the failure"]
    failed: Annotated[str, "path of the node that failed"]
    object: Annotated[str, "object of the budget; empty for one over all"]
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
    """A node asks the operator."""

    reason: Annotated[str, "question"]
    choices: Annotated[tuple[str, ...], "possible answers"]
    object: Annotated[str, "id of the object that it is about"]
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
    items: Annotated[int, "number of items that left with it"]
    number: Annotated[int, "number of the exchange"]


class CrushedEvent(JournalEvent, kind="crushed"):
    """A finger pressed an item harder than it bears; ground truth."""

    object: Annotated[str, "id of the item in the simulation"]
    finger: Annotated[str, "name of the finger"]
    force: Annotated[float, "force of the finger", "N"]
    limit: Annotated[float, "force that the item bears", "N"]
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
    waits: Annotated[bool | None, "true: it waits for its place to be free"] = None
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

"""Hierarchy of failure causes: all names that a failure may have, in one file."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from picktree.files import PicktreeError

EvidenceValue: TypeAlias = "str | float | int | bool | None | list[float] | list[str]"
Evidence: TypeAlias = Mapping[str, EvidenceValue]


@dataclass(frozen=True, slots=True)
class Cause:
    """A dotted name, a sentence for people, and the first remedy to try."""

    name: str
    sentence: str
    remedy: str

    def __str__(self) -> str:
        return self.name

    def __reduce__(self) -> tuple[Callable[[str], Cause], tuple[str]]:
        return cause_named, (self.name,)  # another process compares the same causes by identity


@dataclass(frozen=True, slots=True)
class Family:
    """All causes whose names begin with `name`; a skill declares it when it may end with any of them."""

    name: str

    def __str__(self) -> str:
        return f"{self.name}.*"


class perception:
    """Causes of looking: not found, ambiguous, or no picture."""

    NOT_FOUND = Cause("perception.not_found", "The object was not seen where it should be.", "observe again")
    AMBIGUOUS = Cause("perception.ambiguous", "Several objects fit the request.", "observe from another view")
    STALE = Cause("perception.stale", "The last observation of the object is too old.", "observe again")
    NO_IMAGE = Cause("perception.no_image", "The camera gave no image in time.", "observe again")
    ANY = Family("perception")


class planning:
    """Causes of planning: no IK solution, no path, or a goal in collision."""

    NO_IK = Cause("planning.no_ik", "No joint configuration reaches the pose.", "try another candidate")
    NO_PATH = Cause("planning.no_path", "No path free of collision was found.", "replan with another seed")
    START_IN_COLLISION = Cause(
        "planning.start_in_collision",
        "By the belief, the arm touches something at its present configuration.",
        "retreat safely",
    )
    START_OUTSIDE = Cause(
        "planning.start_outside",
        "The arm starts beyond a joint limit or the workspace, and no motion leads back in.",
        "retreat safely",
    )
    GOAL_IN_COLLISION = Cause(
        "planning.goal_in_collision",
        "Every way to reach the goal touches something.",
        "try another candidate",
    )
    BUDGET = Cause(
        "planning.budget", "The planner used up its collision checks.", "replan with a larger budget"
    )
    CONSTRAINT = Cause(
        "planning.constraint",
        "No motion keeps the path constraint over its whole length.",
        "relax the constraint, or start elsewhere",
    )
    BLOCKED = Cause("planning.blocked", "The planned path is not free any more.", "plan again")
    WORKSPACE = Cause("planning.workspace", "The goal lies outside of the workspace.", "ask for another goal")
    ANY = Family("planning")


class grasp:
    """Causes of grasping: no candidate, missed, or slipped."""

    NO_CANDIDATE = Cause("grasp.no_candidate", "No grasp is left to try.", "clear the space around it")
    MISSED = Cause("grasp.missed", "The fingers closed and hold nothing.", "observe again")
    SLIPPED = Cause("grasp.slipped", "The object slipped out of the fingers.", "observe again, grip harder")
    DOUBLE = Cause("grasp.double", "More than one thing is in the hand.", "put them back into the tote")
    ANY = Family("grasp")


class place:
    """Causes of placing: no room, or a wrong place after the release."""

    OCCUPIED = Cause("place.occupied", "Another body is at the goal of the object.", "choose another spot")
    MISSED = Cause("place.missed", "The object is not where it was put.", "observe again")
    FULL = Cause("place.full", "No free spot is left.", "empty the bin")
    ANY = Family("place")


class insert:
    """Causes of inserting: no hole, jammed, or not in."""

    NOT_FOUND = Cause("insert.not_found", "The hole was not found by feeling for it.", "observe the hole")
    JAMMED = Cause("insert.jammed", "The part is stuck in the hole.", "pull out and try again")
    MISSED = Cause("insert.missed", "The part is not in the hole.", "observe again")
    ANY = Family("insert")


class push:
    """Causes of pushing: no way around, or not moved as wanted."""

    LOST_CONTACT = Cause("push.lost_contact", "The tool no longer touches the object.", "observe again")
    STALLED = Cause("push.stalled", "The object does not move any further.", "push from another side")
    MISSED = Cause("push.missed", "The object did not end where it should.", "push again")
    NO_STROKE = Cause(
        "push.no_stroke", "No stroke that is free moves the object there.", "clear the space around it"
    )
    ANY = Family("push")


class control:
    """Causes of control: tracking, time limits, or the gripper."""

    TRACKING = Cause("control.tracking", "The arm did not follow its trajectory.", "retreat safely")
    TIMEOUT = Cause("control.timeout", "A motion took longer than its time limit.", "retreat safely")
    GRIPPER = Cause("control.gripper", "The fingers did not follow a command.", "reset the gripper")
    ANY = Family("control")


class safety:
    """Causes of safety stops."""

    FORCE_LIMIT = Cause("safety.force_limit", "The force at the wrist exceeded its limit.", "retreat safely")
    SPEED_LIMIT = Cause("safety.speed_limit", "A joint moved faster than its limit.", "retreat safely")
    WORKSPACE = Cause("safety.workspace", "The tool left the workspace.", "retreat safely")
    JOINT_LIMIT = Cause("safety.joint_limit", "A joint came too close to its limit.", "retreat safely")
    ACCELERATION_LIMIT = Cause(
        "safety.acceleration_limit", "A joint would be accelerated beyond its limit.", "plan again"
    )
    SINGULARITY = Cause(
        "safety.singularity", "The arm came to a singular configuration.", "go there by a planned motion"
    )
    TRAJECTORY = Cause("safety.trajectory", "A trajectory is not sound.", "correct its source")
    TORQUE_LIMIT = Cause("safety.torque_limit", "A joint was loaded beyond its limit.", "retreat safely")
    PAYLOAD = Cause(
        "safety.payload", "The hand carries more than the greatest payload.", "let go of it, set it aside"
    )
    STALE_SENSOR = Cause(
        "safety.stale_sensor", "A sensor gives no new readings.", "wait, then retreat safely"
    )
    WATCHDOG = Cause(
        "safety.watchdog", "The arm moved while nobody looked after its motion.", "retreat safely"
    )
    NO_RETREAT = Cause("safety.no_retreat", "There is no safe way out.", "ask for help")
    STOP = Cause("safety.stop", "Motion is refused: a safety stop is not acknowledged.", "retreat safely")
    ANY = Family("safety")


class world:
    """Causes in the world: an unknown object, or a scene that differs from the belief."""

    UNKNOWN_OBJECT = Cause("world.unknown_object", "No such object is known.", "observe")
    DISTURBED = Cause("world.disturbed", "The scene changed during an action on it.", "observe again")
    ANY = Family("world")


class feed:
    """Causes of feeding: nothing came, or nothing was taken away."""

    LATE = Cause("feed.late", "Nothing came within the time.", "wait longer, or check the feed")
    NO_EXCHANGE = Cause(
        "feed.no_exchange", "No empty bin came within the time.", "wait longer, or check the exchange of bins"
    )
    OBSTRUCTED = Cause("feed.obstructed", "The feed waits for the arm to leave.", "retreat safely")
    ANY = Family("feed")


class tree:
    """Causes of the mission itself."""

    TIMEOUT = Cause("tree.timeout", "The branch took longer than its time.", "give it more time")
    ATTEMPTS = Cause("tree.attempts", "All attempts are used up.", "allow more attempts")
    BUDGET = Cause("tree.budget", "The recovery budget is used up.", "allow more, or escalate")
    GIVEN_UP = Cause("tree.given_up", "The operator gave up.", "see to it by hand")
    NO_CASE = Cause("tree.no_case", "No case matches and there is no default.", "add a default")
    MISSING_INPUT = Cause("tree.missing_input", "An input has no value.", "write it before it is read")
    ANY = Family("tree")


class internal:
    """Causes inside the program or a plug-in."""

    ERROR = Cause("internal.error", "The program has a fault of its own.", "report it with the log")
    ANY = Family("internal")


PLUGIN_LINE = "plugin_line"
"""Evidence of an internal.error: line of a plug-in's file that raised it, as `wave.py, line 13`."""


def remedy_of(cause: Cause, evidence: Mapping[str, object]) -> str:
    """Return the first remedy to try: the cause's own, or the line of a plug-in that raised the error."""
    line = evidence.get(PLUGIN_LINE)
    if cause is not internal.ERROR or line is None:
        return cause.remedy
    return f"mend {line}; where that line is right, {cause.remedy}"


FAMILIES: tuple[type, ...] = (
    perception, planning, grasp, place, insert, push, control, safety, world, feed, tree, internal
)  # fmt: skip
OUR_PREFIXES = tuple(family.__name__ for family in FAMILIES)
"""First words of our own causes."""
_causes: dict[str, Cause] = {
    cause.name: cause for family in FAMILIES for cause in vars(family).values() if isinstance(cause, Cause)
}


class CauseError(PicktreeError):
    """A cause that cannot be registered."""


def register_cause(cause: Cause) -> Cause:
    """Add a plug-in's cause, and return it.

    Raises CauseError for a malformed name, one of a family of ours, or one that another has registered
    with another meaning.
    """
    prefix = cause.name.split(".")[0]
    if not re.fullmatch(r"[a-z]\w*(\.[a-z]\w*)+", cause.name):
        raise CauseError(f"cause {cause.name!r}: must be lower-case words with dots, as 'grasp.missed'")
    if prefix in OUR_PREFIXES:
        raise CauseError(f"cause {cause.name!r}: the prefix {prefix!r} belongs to picktree; use your own")
    known = _causes.setdefault(cause.name, cause)
    if known != cause:
        raise CauseError(
            f"cause {cause.name!r}: it is registered already with another meaning ({known.sentence!r}); "
            "use a prefix of your own"
        )
    return known


def known_causes() -> Mapping[str, Cause]:
    """Return a copy of all registered causes, for `restore_causes`."""
    return dict(_causes)


def restore_causes(causes: Mapping[str, Cause]) -> None:
    """Discard later registrations, after a plug-in has failed or before its file runs again."""
    _causes.clear()
    _causes.update(causes)


def all_causes() -> tuple[Cause, ...]:
    """Return every registered cause, in the order of registration."""
    return tuple(_causes.values())


def cause_named(name: str) -> Cause:
    """Return the cause of that name. Raises PicktreeError with the known names for an unknown name."""
    try:
        return _causes[name]
    except KeyError:
        raise PicktreeError(f"unknown cause {name!r}; known: {', '.join(_causes)}") from None


def matches(pattern: str, cause: Cause | str) -> bool:
    """Whether a `when:` pattern (`grasp.missed`, `grasp.*`, `*`) covers the cause, or the cause of that name.

    A log may have causes of plug-ins that are not registered here: they are known by name only. `*` does not
    match `internal.error`: a fault of the program is not to be recovered by accident.
    """
    name = str(cause)
    if pattern == "*":
        return name != internal.ERROR.name
    if pattern.endswith(".*"):
        return name.startswith(pattern[:-1])
    return name == pattern


@dataclass(frozen=True, slots=True)
class FailureReport:
    """One failure as it travels to the root: cause, sentence, evidence, where; others that led to it."""

    cause: Cause
    message: str
    evidence: Evidence = field(default_factory=dict[str, EvidenceValue])
    node: str = ""
    attached: tuple[FailureReport, ...] = ()


class Failure(Exception):
    """Raised by a skill's body: the node ends in FAILURE with this report. No other code catches it."""

    def __init__(self, cause: Cause, message: str, **evidence: EvidenceValue) -> None:
        super().__init__(f"{cause}: {message}")
        self.cause = cause
        self.message = message
        self.evidence: Evidence = evidence

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled_failure, (type(self), self.args), self.__dict__


def _unpickled_failure(kind: type[Failure], args: tuple[str, ...]) -> Failure:
    return kind.__new__(kind, *args)

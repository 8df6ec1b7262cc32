"""Guards in a handler: conditions on whether a recovery may help against the handled cause."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, cast

from picktree.files import PicktreeError, suggest_name
from picktree.trees import In, Node, NodeStatus, PortProblem, PortValues, control_flow, port
from picktree.world import all_causes, cause_named, matches

if TYPE_CHECKING:
    from picktree.world import Cause


class CauseGuard(Node, abstract=True):
    """Base class of conditions on the cause: SUCCESS when it is in a list, else FAILURE without a report."""

    flow = control_flow.LeafFlow(steady=True)
    kind = "condition"
    played = False
    cause: In[str] = port("the cause that is being handled: output `cause` of the Recover")

    def patterns(self) -> tuple[str, ...]:
        """Return the cause patterns for which the guard succeeds."""
        raise NotImplementedError

    def handled(self) -> Cause | None:
        """Return the handled cause; None before the first failure."""
        name = str(self.input("cause"))
        try:
            return cause_named(name) if name else None
        except PicktreeError:
            return None

    def on_tick(self) -> NodeStatus:
        cause = self.handled()
        helps = cause is not None and any(matches(pattern, cause) for pattern in self.patterns())
        return NodeStatus.SUCCESS if helps else NodeStatus.FAILURE


class WouldHelp(CauseGuard, abstract=True):
    """Base class of guards for one kind of recovery."""

    helps: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, *, abstract: bool = False) -> None:
        cls.example = f'{cls.__name__}: {{cause: "{{cause}}"}}'
        super().__init_subclass__(abstract=abstract)

    def patterns(self) -> tuple[str, ...]:
        return self.helps


class CauseIs(CauseGuard):
    """Whether the cause that is being handled is one of these, or of one of these families."""

    example = """
    CauseIs: {cause: "{cause}", of: ["grasp.*", perception.not_found]}
    """

    of: In[list[str]] = port("causes, or families such as `grasp.*`")

    def patterns(self) -> tuple[str, ...]:
        return tuple(self.of)

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        patterns = cast("list[str]", given.constants.get("of", []))
        names = [cause.name for cause in all_causes()]
        unknown = (p for p in patterns if not any(matches(p, cause) for cause in all_causes()))
        return tuple(
            PortProblem(
                "of", f"{pattern!r} is neither a cause nor a family of causes", suggest_name(pattern, names)
            )
            for pattern in unknown
        )


class WouldLookingHelp(WouldHelp):
    """Whether another look may help: an object was not at its believed place, or was not seen well."""

    helps = (
        "perception.*", "grasp.no_candidate", "grasp.missed", "grasp.slipped", "place.missed",
        "place.occupied", "insert.missed", "insert.not_found", "push.lost_contact", "push.missed",
        "planning.blocked", "planning.goal_in_collision", "world.*", "safety.force_limit",
    )  # fmt: skip


class WouldARetreatHelp(WouldHelp):
    """Whether a retreat may help: a safety stop waits to be acknowledged, or the arm is too near an
    obstacle."""

    helps = (
        "safety.*", "control.*", "planning.start_in_collision", "planning.start_outside", "planning.blocked",
        "grasp.missed", "grasp.slipped", "world.disturbed", "feed.obstructed", "insert.jammed",
        "push.stalled", "tree.timeout", "internal.*",
    )  # fmt: skip


class WouldAnotherGraspHelp(WouldHelp):
    """Whether another grasp may help, at another place or after a new look."""

    helps = (
        "grasp.missed", "grasp.slipped", "planning.no_ik", "planning.goal_in_collision", "planning.no_path",
        "insert.jammed", "insert.missed", "safety.payload",
    )  # fmt: skip


class WouldAGripperResetHelp(WouldHelp):
    """Whether a gripper reset may help: the empty fingers did not follow a command."""

    helps = ("control.gripper", "control.timeout", "grasp.missed", "grasp.slipped")


class WouldReplanningHelp(WouldHelp):
    """Whether planning in another way may help: with another seed, more checks or more clearance."""

    helps = (
        "planning.no_path", "planning.budget", "planning.blocked", "planning.no_ik", "planning.constraint",
        "planning.goal_in_collision", "control.tracking", "safety.acceleration_limit", "safety.singularity",
        "safety.joint_limit",
    )  # fmt: skip


class WouldPushingHelp(WouldHelp):
    """Whether pushing the object free may help: the hand does not fit around it at its place."""

    helps = ("grasp.no_candidate", "planning.goal_in_collision", "planning.no_ik", "push.stalled")


class WouldWaitingHelp(WouldHelp):
    """Whether waiting may help: a sensor, a camera or the arm may recover, and a rolling object may come to
    rest."""

    helps = (
        "perception.no_image", "safety.stale_sensor", "safety.watchdog", "control.tracking",
        "control.timeout", "control.gripper", "world.disturbed", "feed.*", "tree.timeout",
    )  # fmt: skip

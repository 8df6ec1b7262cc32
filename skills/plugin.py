"""Everything that a plug-in's file needs, from one import: `from picktree.skills.plugin import Skill, port`.

Each name is imported on first use, so that a skill loads only its own dependencies.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from picktree.robot import (
        World as World,
    )
    from picktree.robot.control import (
        CartesianStiffness as CartesianStiffness,
    )
    from picktree.robot.control import (
        CompliantMotion as CompliantMotion,
    )
    from picktree.robot.control import (
        ContactState as ContactState,
    )
    from picktree.robot.control import (
        GuardedMoveResult as GuardedMoveResult,
    )
    from picktree.robot.control import (
        JogFeedback as JogFeedback,
    )
    from picktree.robot.control import (
        JogResult as JogResult,
    )
    from picktree.robot.control import (
        Twist as Twist,
    )
    from picktree.robot.planning import (
        BoxConstraint as BoxConstraint,
    )
    from picktree.robot.planning import (
        HeldObject as HeldObject,
    )
    from picktree.robot.planning import (
        JointGoal as JointGoal,
    )
    from picktree.robot.planning import (
        LineGoal as LineGoal,
    )
    from picktree.robot.planning import (
        NamedGoal as NamedGoal,
    )
    from picktree.robot.planning import (
        OffsetGoal as OffsetGoal,
    )
    from picktree.robot.planning import (
        PoseGoal as PoseGoal,
    )
    from picktree.robot.planning import (
        RegionGoal as RegionGoal,
    )
    from picktree.robot.planning import (
        Request as Request,
    )
    from picktree.robot.planning import (
        Scaling as Scaling,
    )
    from picktree.robot.planning import (
        SearchProblem as SearchProblem,
    )
    from picktree.robot.planning import (
        UprightConstraint as UprightConstraint,
    )
    from picktree.trees import (
        ARM as ARM,
    )
    from picktree.trees import (
        CAMERA as CAMERA,
    )
    from picktree.trees import (
        GRIPPER as GRIPPER,
    )
    from picktree.trees import (
        ConditionNode as ConditionNode,
    )
    from picktree.trees import (
        ControlNode as ControlNode,
    )
    from picktree.trees import (
        Decorator as Decorator,
    )
    from picktree.trees import (
        Doing as Doing,
    )
    from picktree.trees import (
        In as In,
    )
    from picktree.trees import (
        NodeStatus as NodeStatus,
    )
    from picktree.trees import (
        Out as Out,
    )
    from picktree.trees import (
        Skill as Skill,
    )
    from picktree.trees import (
        Steps as Steps,
    )
    from picktree.trees import (
        child as child,
    )
    from picktree.trees import (
        children as children,
    )
    from picktree.trees import (
        optional_child as optional_child,
    )
    from picktree.trees import (
        port as port,
    )
    from picktree.trees import (
        table as table,
    )
    from picktree.world import (
        Array as Array,
    )
    from picktree.world import (
        BeliefObject as BeliefObject,
    )
    from picktree.world import (
        Cause as Cause,
    )
    from picktree.world import (
        Failure as Failure,
    )
    from picktree.world import (
        ObjectId as ObjectId,
    )
    from picktree.world import (
        Pose as Pose,
    )
    from picktree.world import (
        Trajectory as Trajectory,
    )
    from picktree.world import (
        Wrench as Wrench,
    )
    from picktree.world import (
        control as control,
    )
    from picktree.world import (
        feed as feed,
    )
    from picktree.world import (
        grasp as grasp,
    )
    from picktree.world import (
        insert as insert,
    )
    from picktree.world import (
        internal as internal,
    )
    from picktree.world import (
        perception as perception,
    )
    from picktree.world import (
        place as place,
    )
    from picktree.world import (
        planning as planning,
    )
    from picktree.world import (
        push as push,
    )
    from picktree.world import (
        register_cause as register_cause,
    )
    from picktree.world import (
        safety as safety,
    )
    from picktree.world import (
        tree as tree,
    )
    from picktree.world import (
        world as world,
    )

_NAMES: Final = {
    "trees": (
        "Skill", "Steps", "Doing", "ARM", "GRIPPER", "CAMERA", "ConditionNode", "Decorator",
        "ControlNode", "NodeStatus", "In", "Out", "port", "child", "children", "optional_child",
        "table",
    ),
    "world": (
        "Cause", "Failure", "register_cause", "perception", "planning", "grasp", "place", "insert",
        "push", "control", "safety", "world", "feed", "tree", "internal", "BeliefObject",
        "ObjectId", "Pose", "Wrench", "Array", "Trajectory",
    ),
    "robot": ("World",),
    "robot.planning": (
        "NamedGoal", "JointGoal", "PoseGoal", "RegionGoal", "LineGoal", "OffsetGoal",
        "UprightConstraint", "BoxConstraint", "Request", "HeldObject", "Scaling", "SearchProblem",
    ),
    "robot.control": (
        "CompliantMotion", "ContactState", "CartesianStiffness", "Twist", "GuardedMoveResult",
        "JogFeedback", "JogResult",
    ),
}  # fmt: skip
"""Names by the door that has them."""
_DOORS: Final = {name: door for door, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Return the object of a name that a plug-in imports. Raises AttributeError for another name."""
    if name not in _DOORS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"picktree.{_DOORS[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_DOORS)

"""Failures of the start of a plan: in collision, or beyond the soft limits or the workspace."""

from __future__ import annotations

from collections.abc import Sequence

from ...world.causes import Failure, planning
from ...world.robot_model.joint_limits import DEGREES_HINT
from ...world.values import Array
from .obstructions import BlockingBodies
from .planning_failures import contact_lines, how_near, how_outside, join_words
from .requests import ContactPair
from .tool_room import StartExcess

MAX_NAMED_JOINTS = 3
"""Greatest number of joints that the sentence names."""


def start_in_collision(q: Array, contacts: Sequence[ContactPair], *, believed: bool = True) -> Failure:
    """Build the failure of a start in collision. `believed`: the start q (n,) is the arm's, not one that the
    request gave."""
    worst = contacts[0]
    return Failure(
        planning.START_IN_COLLISION,
        f"{_start(believed)} {worst.a} is {how_near(worst)} {worst.b}",
        pairs=contact_lines(contacts),
        depth=-worst.distance,
        configuration=q.tolist(),
    )


def start_outside(
    q: Array,
    excess: StartExcess,
    contacts: Sequence[ContactPair] = (),
    *,
    why: str = "",
    believed: bool = True,
) -> Failure:
    """Build the failure of a start q (n,) beyond soft limits or workspace, from which no motion leads back
    in.

    `contacts`: pairs in which the arm is stuck there; `why`: reason in words; `believed`: as in
    `start_in_collision`.
    """
    if excess.more_than_a_turn:
        why = DEGREES_HINT
    elif contacts:
        why = f"{contacts[0].a} is {how_near(contacts[0])} {contacts[0].b}"
    tool = excess.tool
    return Failure(
        planning.START_OUTSIDE,
        f"{_start(believed)} {describe_excess(excess)}{f'; {why}' if why else ''}",
        joints=[one.joint for one in excess.joints],
        beyond=[one.size for one in excess.joints],
        axis="" if tool is None else tool.axis,
        by=0.0 if tool is None else tool.by,
        pairs=contact_lines(contacts),
        depth=-contacts[0].distance if contacts else 0.0,
        configuration=q.tolist(),
    )


def no_way_back(between: BlockingBodies) -> str:
    """Describe that no motion leads back in; `between`: bodies in the way of the straight motions."""
    what = f": {join_words(between.pairs[:3])} in the way" if between.pairs else ""
    return f"no motion leads back in{what}"


def describe_excess(excess: StartExcess) -> str:
    """Describe the joints beyond their limits, and the side of the workspace that the tool is beyond."""
    words = [str(one) for one in excess.joints[:MAX_NAMED_JOINTS]]
    more = len(excess.joints) - MAX_NAMED_JOINTS
    if more > 0:
        words.append("1 more joint is beyond its limit" if more == 1 else f"{more} more are beyond theirs")
    if excess.tool is not None:
        words.append(f"the tool is {how_outside(excess.tool)}")
    return join_words(words)


def _start(believed: bool) -> str:
    return "where the arm is," if believed else "where the motion starts,"

"""The ends of a mission of scripted leaves, as the linter sees them, in words."""

from __future__ import annotations

from textwrap import indent
from typing import TYPE_CHECKING

from picktree.authoring.lint.mission_survey import FlowAnalysis
from picktree.authoring.lint.outcomes import (
    HAND_EMPTY,
    HAND_SECURED,
    HAND_SHARED,
    HELD_OUTSIDE,
    UNREPORTED,
    FailureReasons,
    FlowState,
    Outcomes,
    States,
)
from picktree.recovery import NODES as RECOVERY
from picktree.skills import WatchScene
from picktree.trees import Out, Skill, Steps, port
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import control, grasp, perception

from .scripted import FILE

if TYPE_CHECKING:
    from picktree.robot import World


class Pick(Skill):
    """Takes something, or does not."""

    causes = (grasp.MISSED, grasp.SLIPPED)
    hand_after = "full"

    def run(self, world: World) -> Steps:
        yield


class Look(Skill):
    """Looks, and says what it saw."""

    seen: Out[str] = port("what it saw")
    causes = (perception.NOT_FOUND,)

    def run(self, world: World) -> Steps:
        yield


class Drop(Skill):
    """Opens the hand."""

    causes = (control.GRIPPER,)
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        yield


class Mend(Skill):
    """Never fails."""

    mended: Out[str] = port("what was done")

    def run(self, world: World) -> Steps:
        yield


REGISTRY = NodeRegistry((Pick, Look, Drop, Mend, *RECOVERY, WatchScene), installed=False)


def ways(body: str) -> dict[str, list[str]]:
    """The ends of a mission, each state as the keys that are written (`?`: perhaps), what the hand may hold
    (`!`: reached only by what no node declares), and the causes of a failure (`~`: declared by no node)."""
    text = "picktree: 1\nkind: mission\ntrees:\n  Main:\n" + indent(body, "    ")
    mission = parse_mission(text, FILE, REGISTRY)
    walk = FlowAnalysis(mission)
    walk.enter(mission.main)
    flow: Outcomes = walk.ends["Main"]
    keys = walk.layout_of("Main").keys

    def state(one: FlowState) -> str:
        written = [key if one.sure & bit else f"{key}?" for key, bit in keys.items() if one.maybe & bit]
        hand = {"empty": HAND_EMPTY, "kept": HAND_SECURED, "outer": HELD_OUTSIDE, "shared": HAND_SHARED}
        held = [word for word, bit in hand.items() if one.hand & bit]
        held += ["full"] if one.hand & ~sum(hand.values()) else []
        return f"{' '.join(written)} | {'/'.join(held)}{'!' if one.doubtful else ''}".strip()

    def causes(why: FailureReasons) -> str:
        loud = [*walk.causes.names(why.loud), *(["no report"] if why.loud & UNREPORTED else [])]
        quiet = [f"~{name}" for name in walk.causes.names(why.quiet)]
        return ", ".join([*loud, *(name for name in quiet if "internal" in name)])

    def all_of(states: States) -> list[str]:
        return sorted(state(one) for one in states)

    return {
        "success": all_of(flow.success),
        "failure": sorted(f"{state(one)}: {causes(why)}" for one, why in flow.failure.items()),
        "skipped": all_of(flow.skipped),
        "running": all_of(flow.running),
        "never": [
            f"{spec.name}: {walk.blocked[id(spec)]}"
            for spec in mission.main.root.iterate()
            if id(spec) not in walk.reached
        ],
        "handled": sorted(label for _, label in walk.handled),
    }

"""Where a debugger stops a tree, and that the tree does not notice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from picktree.robot import World
from picktree.session import Breakpoint, Debugger, DebuggerStop
from picktree.trees import BehaviourTree, NodeStatus, build
from picktree.trees.loading import parse_mission

from ..trees.scripted import FakeWorld, Run, registry, start

MISSION = """
Main:
  Sequence:
    - Scripted: {name: A, script: R S, breakpoint: before}
    - Fallback:
        - Scripted: {name: B, script: grasp.missed, breakpoint: after}
        - Scripted: {name: C, script: RR S}
    - AlwaysSuccess: {_skipIf: 'true', breakpoint: after}
"""


class Script:
    """Does at each stop what the test says, the last again and again, and keeps where it stopped."""

    def __init__(self, *acts: Callable[[Debugger], object]) -> None:
        self._acts = list(acts)
        self.stops: list[str] = []
        self.times: list[float] = []

    def __call__(self, debugger: Debugger, stop: DebuggerStop) -> None:
        node = debugger.tree.find(stop.path) if stop.path else debugger.tree.root
        self.stops.append(f"{stop.when} {stop.path.removeprefix('Main/') or 'Main'} {node.state}")
        self.times.append(round(debugger.tree.root.world.clock.now, 2))
        act = self._acts.pop(0) if len(self._acts) > 1 else self._acts[0]
        act(debugger)


def run(script: Script, mission: str = MISSION, *, at_start: bool = False) -> Run:
    """To the end, each tick followed by the session's word to the debugger."""
    run = start(mission)
    debugger = Debugger(script, at_start=at_start)
    debugger.attach(run.tree)
    while run.tick() is NodeStatus.RUNNING:
        debugger.pause_after_tick()
    debugger.pause_after_tick()
    return run


def go_on(debugger: Debugger) -> None: ...


def test_it_stops_at_the_breakpoints_of_the_file_and_time_stands_still() -> None:
    script = Script(go_on)
    run(script)
    assert script.stops == ["before Sequence/A RUNNING", "after Sequence/Fallback/B FAILURE"]
    assert script.times == [0.0, 0.05]


def test_next_stops_at_each_start_and_end_whatever_ends_the_node() -> None:
    script = Script(Debugger.next)
    run(script, "Main: {Timeout: {msec: 50, do: {Sequence: [{Scripted: {name: A}}, {Scripted: {name: B, "
        "script: RRR}}, {Scripted: {name: never}}]}}}", at_start=True)  # fmt: skip
    assert script.stops == [
        "before Main RUNNING",
        "before Timeout RUNNING",
        "before Timeout/Sequence RUNNING",
        "before Timeout/Sequence/A RUNNING",
        "after Timeout/Sequence/A SUCCESS",
        "before Timeout/Sequence/B RUNNING",
        "after Timeout/Sequence/B IDLE",
        "after Timeout/Sequence IDLE",
        "after Timeout FAILURE",
        "after Main FAILURE",
    ]


def test_a_node_that_does_not_start_does_not_end() -> None:
    script = Script(Debugger.next)
    run(script, "Main: {Sequence: [{AlwaysSuccess: {_skipIf: 'true'}}, {AlwaysSuccess: {name: B, _while: "
        "'false'}}, {Scripted: {name: C, _successIf: 'true'}}]}", at_start=True)  # fmt: skip
    assert [stop for stop in script.stops if "Sequence/" in stop] == []


def test_step_stops_at_the_end_of_ticks() -> None:
    script = Script(Debugger.step, lambda debugger: debugger.step(2), Debugger.step)
    run(script, "Main: {Scripted: {script: RRRRR S}}", at_start=True)
    assert script.stops == ["before Main RUNNING", *["tick Main RUNNING"] * 4, "tick Main SUCCESS"]
    assert script.times == [0.0, 0.05, 0.15, 0.2, 0.25, 0.3]


def test_a_breakpoint_stops_a_step_short() -> None:
    script = Script(lambda debugger: debugger.step(5), go_on)
    run(script, at_start=True)
    assert script.stops == [
        "before Main RUNNING", "before Sequence/A RUNNING", "after Sequence/Fallback/B FAILURE"
    ]  # fmt: skip


def test_breakpoints_are_set_listed_and_removed() -> None:
    def look(debugger: Debugger) -> None:
        assert debugger.breakpoints == {
            1: Breakpoint("Main/Sequence/A", "before"),
            2: Breakpoint("Main/Sequence/Fallback/B", "after"),
            3: Breakpoint("Main/Sequence/AlwaysSuccess", "after"),
        }
        assert debugger.remove(2)
        assert not debugger.remove(2)
        assert debugger.add("Main/Sequence/Fallback/C", "after") == 4
        assert debugger.add("Main/Sequence/Fallback/C", "after") == 4

    script = Script(look, go_on)
    run(script)
    assert script.stops == ["before Sequence/A RUNNING", "after Sequence/Fallback/C SUCCESS"]


def test_turned_off_it_does_not_stop_again() -> None:
    script = Script(Debugger.turn_off)
    run(script)
    assert len(script.stops) == 1


@pytest.mark.parametrize("how", [go_on, Debugger.next, Debugger.step])
def test_the_tree_goes_on_as_without_it(how: Callable[[Debugger], object]) -> None:
    alone = start(MISSION)
    alone.to_end()
    watched = run(Script(how), at_start=True)
    assert watched.trace == alone.trace
    assert watched.report == alone.report


def test_an_interrupt_at_the_prompt_reaches_the_session() -> None:
    def interrupt(debugger: Debugger) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(Script(interrupt))


def test_an_edited_mission_brings_its_own_breakpoints_and_keeps_those_set_by_hand() -> None:
    def tree(body: str) -> BehaviourTree:
        text = f"picktree: 1\nkind: mission\ntrees: {{Main: {{Sequence: [{body}]}}}}\n"
        mission = parse_mission(text, Path("m.yaml"), registry())
        return build(mission, cast("World", FakeWorld()))

    debugger = Debugger(go_on_at)
    debugger.attach(tree("{Scripted: {name: A, breakpoint: before}}, {Scripted: {name: B}}"))
    by_hand = debugger.add("Main/Sequence/B", "after")
    debugger.follow(tree("{Scripted: {name: A}}, {Scripted: {name: B, breakpoint: before}}"))
    assert debugger.breakpoints == {
        by_hand: Breakpoint("Main/Sequence/B", "after"),
        3: Breakpoint("Main/Sequence/B", "before"),
    }


def go_on_at(debugger: Debugger, stop: DebuggerStop) -> None: ...

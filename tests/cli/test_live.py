"""Display of a running mission."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from rich.console import Console

from picktree.apps.cli.progress import LinesDisplay, LiveDisplay, deepest_running, node_states
from picktree.apps.cli.state_text import tree_rows
from picktree.logs import RunResult
from picktree.session import Execution, RunCounters
from picktree.trees import NodeStatus
from picktree.world import JournalEvent, NodeState, Tick, TreeNode
from picktree.world.event_types import ItemDoneEvent, SetAsideEvent

STRUCTURE = (
    TreeNode("Main", "Sequence", "Main", "", ("Main/1", "Main/2", "Main/3"), {}),
    TreeNode("Main/1", "Observe", "Observe", "Main", (), {}),
    TreeNode("Main/2", "Recover", "careful", "Main", ("Main/2/1", "Main/2/2"), {}),
    TreeNode("Main/2/1", "Grasp", "Grasp", "Main/2", (), {}),
    TreeNode("Main/2/2", "SafeRetreat", "SafeRetreat", "Main/2", (), {}),
    TreeNode("Main/3", "Fallback", "Fallback", "Main", ("Main/3/1",), {}),
    TreeNode("Main/3/1", "GoTo", "GoTo", "Main/3", (), {}),
)


def executing(structure: tuple[TreeNode, ...]) -> Execution:
    """A run of a tree of these nodes, as far as a display looks at it."""
    leaves = frozenset(node.path for node in structure if not node.children)
    tree = SimpleNamespace(structure=lambda: structure, leaves=leaves)
    return cast("Execution", SimpleNamespace(tree=tree, tally=RunCounters(), items_total=4))


def happen(run: Execution, *events: JournalEvent) -> None:
    run.tally.take(0.0, events, frozenset(), ())


def report_of(structure: tuple[TreeNode, ...], *statuses: str, cause: str = "", ticked: bool = True) -> Tick:
    """`cause` is that of the nodes in FAILURE."""
    nodes = (
        NodeState(
            info.path,
            info.id,
            NodeStatus(status),
            ticked,
            "the fingers hold nothing" if status == "FAILURE" else "",
            cause if status == "FAILURE" else "",
        )
        for info, status in zip(structure, statuses, strict=True)
    )
    return Tick("RUNNING", "", tuple(nodes))


def report(*statuses: str, cause: str = "", ticked: bool = True) -> Tick:
    return report_of(STRUCTURE, *statuses, cause=cause, ticked=ticked)


RETREATING = report(
    "RUNNING", "SUCCESS", "RUNNING", "FAILURE", "RUNNING", "IDLE", "IDLE", cause="grasp.missed"
)


def test_rows_show_what_runs_and_what_is_beside_it_where_there_is_room() -> None:
    whole = [
        "▶ Sequence Main",
        "  ✓ Observe",
        "  ▶ Recover careful",
        "    ✗ Grasp  grasp.missed: the fingers hold nothing",
        "    ▶ SafeRetreat",
        "  · Fallback",
    ]
    for room, rows in ((20, whole), (4, [whole[0], *whole[2:5]])):
        assert [row.plain for row in tree_rows(node_states(STRUCTURE, RETREATING.nodes), room)] == rows


def test_the_leaf_that_has_just_failed_is_kept_with_what_is_above_it() -> None:
    """All above it may run on, and fill the room."""
    failed = report("RUNNING", "SUCCESS", "RUNNING", "FAILURE", "IDLE", "IDLE", "IDLE", cause="grasp.missed")
    leaf = STRUCTURE[3].path
    for room in (3, 2, 1):
        rows = [row.plain.strip() for row in tree_rows(node_states(STRUCTURE, failed.nodes), room, {leaf})]
        assert rows[-1] == "✗ Grasp  grasp.missed: the fingers hold nothing"
    assert rows == ["✗ Grasp  grasp.missed: the fingers hold nothing"]


def test_rows_of_a_tree_that_does_not_run() -> None:
    idle = report(*["IDLE"] * 7)
    assert [row.plain for row in tree_rows(node_states(STRUCTURE, idle.nodes), 4)] == ["· Sequence Main"]
    assert deepest_running(idle.nodes) == "nothing"


def test_lines_tell_of_items_long_silence_and_once_of_failed_leaves(result: RunResult) -> None:
    file = io.StringIO()
    quiet = report("RUNNING", "SUCCESS", "RUNNING", "RUNNING", "IDLE", "IDLE", "IDLE")
    with LinesDisplay(file) as view:
        run = executing(STRUCTURE)
        view.started(run, Path("runs/1"))
        view.ticked(0.05, quiet, 0, 4)
        view.ticked(3.0, RETREATING, 0, 4)
        kept = report(*[n.status for n in RETREATING.nodes], cause="grasp.missed", ticked=False)
        view.ticked(3.05, kept, 0, 4)
        happen(run, ItemDoneEvent("", object="red_ball_1", into="red_bin"))
        view.ticked(9.5, quiet, 1, 4)
        view.ticked(39.4, quiet, 1, 4)
        view.ticked(39.5, quiet, 1, 4)
        view.finished(result)
    assert (
        file.getvalue()
        == """\
recording to runs/1
    3.00 s  Main/2/1: grasp.missed: the fingers hold nothing
    9.50 s  1 of 4 items done
   39.50 s  at Main/2/1
"""
    )


def test_lines_tell_done_put_elsewhere_and_set_aside_apart() -> None:
    file = io.StringIO()
    quiet = report(*["RUNNING"] * 7)
    with LinesDisplay(file) as view:
        run = executing(STRUCTURE)
        view.started(run, Path("runs/1"))
        happen(run, ItemDoneEvent("", object="ball_1", into="red_bin"))
        happen(run, ItemDoneEvent("", object="can_1", into=""), SetAsideEvent("", object="can_2"))
        view.ticked(1.0, quiet, 2, 4)
        happen(run, ItemDoneEvent("", object="ball_1", into="red_bin"))
        view.ticked(2.0, quiet, 3, 4)
        happen(run, ItemDoneEvent("", object="can_2", into="red_bin"))
        view.ticked(3.0, quiet, 4, 4)
    assert (
        file.getvalue()
        == """\
recording to runs/1
    1.00 s  1 of 4 items done, 1 put elsewhere, 1 set aside
    3.00 s  2 of 4 items done, 1 put elsewhere
"""
    )


def test_lines_tell_of_edits_and_follow_the_edited_tree() -> None:
    file = io.StringIO()
    with LinesDisplay(file) as view:
        view.started(executing(STRUCTURE), Path("runs/1"))
        view.notified(1.0, "the edit is not taken over:\nm.yaml:3:1: error P207: [no markup]")
        other = (*STRUCTURE[:2], replace(STRUCTURE[2], children=()))  # Main/2 is a leaf now
        view.edited(executing(other))
        view.ticked(3.0, report_of(other, "RUNNING", "SUCCESS", "FAILURE", cause="grasp.missed"), 0, 4)
    assert (
        file.getvalue()
        == """\
recording to runs/1
    1.00 s  the edit is not taken over:
m.yaml:3:1: error P207: [no markup]
    3.00 s  Main/2: grasp.missed: the fingers hold nothing
"""
    )


def test_live_view_tells_above_the_tree_and_leaves_nothing_behind(
    result: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("picktree.apps.cli.progress._REDRAW_PERIOD", -1.0)
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=60, height=20, color_system=None)
    with LiveDisplay(console) as view:
        run = executing(STRUCTURE)
        view.started(run, Path("runs/1"))
        view.notified(1.0, "the edit is good")
        happen(run, ItemDoneEvent("", object="ball_1", into="red_bin"))
        view.ticked(12.0, RETREATING, 1, 4)
        drawn = file.getvalue()
        view.edited(executing(STRUCTURE[:2]))
        view.ticked(13.0, report_of(STRUCTURE[:2], "RUNNING", "RUNNING"), 0, 4)
        edited = file.getvalue().removeprefix(drawn)
        view.finished(result)
    assert "    1.00 s  the edit is good\n" in drawn
    assert "    ▶ SafeRetreat" in drawn and "  ▶ Observe" not in drawn
    assert "1 of 4 items done   simulated 12.0 s   wall " in drawn
    assert "\n300 units an hour, no failure, no assist" in drawn
    assert "  ▶ Observe" in edited
    assert file.getvalue().endswith("\x1b[2K")

"""Data of the lanes and the drawn tree: nodes, visits, items, statuses, charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from picktree.analysis import Run
from picktree.analysis.report import Section
from picktree.analysis.report.node_panels import OUTCOMES, item_spans, pack_lanes, pack_tree
from picktree.analysis.report.tick_table import ABSENT, STATUSES, TICKED, RunNode, nodes_of, tick_table
from picktree.files import PicktreeError
from picktree.session import RunRequest, Session
from picktree.trees.loading import parse_mission
from picktree.world import BlackboardWrite, Tree, TreeNode

from ..logs.scripted_log import Said, begins, ends, record, tree


def data(section: Section) -> Mapping[str, Any]:
    assert isinstance(section.data, Mapping)
    return section.data


def told(section: Section) -> list[tuple[str, int, int, str, str, str]]:
    """Path, first and last tick, outcome, item and cause of each visit that was packed."""
    packed = data(section)
    visits = packed["visits"]
    words = visits["words"]
    return [
        (
            packed["nodes"][visits["node"][k]]["path"],
            int(visits["first"][k]),
            int(visits["last"][k]),
            packed["outcomes"][visits["outcome"][k]],
            words[visits["item"][k]],
            words[visits["cause"][k]],
        )
        for k in range(len(visits["node"]))
    ]


LOOP = tree(
    "Main", "Main/ForEach", "Main/ForEach/Sequence", "Main/ForEach/Sequence/Grasp",
    "Main/ForEach/Sequence/Place",
)  # fmt: skip
GRASP, PLACE = "Main/ForEach/Sequence/Grasp", "Main/ForEach/Sequence/Place"


@pytest.fixture
def loop_log(tmp_path: Path) -> Path:
    """Two elements: the first is grasped and placed, the grasp of the second fails."""
    return record(
        tmp_path / "log.mcap",
        LOOP,
        10,
        {
            0: [begins("Main"), begins("Main/ForEach")],
            1: [
                BlackboardWrite("Main/item", "a", "Main/ForEach"),
                begins("Main/ForEach/Sequence"),
                begins(GRASP, "a"),
            ],
            3: [ends(GRASP), begins(PLACE, "a", into="bin")],
            5: [ends(PLACE), ends("Main/ForEach/Sequence")],
            6: [
                BlackboardWrite("Main/item", "b", "Main/ForEach"),
                begins("Main/ForEach/Sequence"),
                begins(GRASP, "b"),
            ],
            8: [
                ends(GRASP, "FAILURE", "grasp.missed", width=0.001),
                ends("Main/ForEach/Sequence", "FAILURE"),
            ],
        },
    )


def test_nodes_of_an_edited_mission_stand_among_their_siblings() -> None:
    def node(path: str, *children: str) -> TreeNode:
        name = path.rsplit("/", 1)[-1]
        return TreeNode(path, name, name, path.rpartition("/")[0], tuple(children))

    before = Tree((node("M", "M/a", "M/c"), node("M/a", "M/a/x"), node("M/a/x"), node("M/c")))
    after = Tree((node("M", "M/a", "M/b"), node("M/a", "M/a/y"), node("M/a/y"), node("M/b")))
    assert nodes_of([before, after]) == (
        RunNode("M", "M", "M", -1, False),
        RunNode("M/a", "a", "a", 0, False),
        RunNode("M/a/x", "x", "x", 1, True),
        RunNode("M/a/y", "y", "y", 1, True),
        RunNode("M/c", "c", "c", 0, True),
        RunNode("M/b", "b", "b", 0, True),
    )


def test_lanes_tell_each_visit_with_what_it_was_about(loop_log: Path) -> None:
    with Run(loop_log) as run:
        section = pack_lanes(run)
    assert told(section) == [
        ("Main", 0, 9, "RUNNING", "", ""),
        ("Main/ForEach", 0, 9, "RUNNING", "", ""),
        ("Main/ForEach/Sequence", 1, 5, "SUCCESS", "a", ""),
        (GRASP, 1, 3, "SUCCESS", "a", ""),
        (PLACE, 3, 5, "SUCCESS", "a", ""),
        ("Main/ForEach/Sequence", 6, 8, "FAILURE", "b", ""),
        (GRASP, 6, 8, "FAILURE", "b", "grasp.missed"),
    ]
    visits = data(section)["visits"]
    assert visits["parent"].tolist() == [-1, 0, 1, 2, 2, 1, 5]
    assert visits["words"][visits["inputs"][4]] == '{"object":"a","into":"bin"}'
    assert visits["words"][visits["evidence"][6]] == '{"width":0.001}'


def test_bands_of_items_span_the_outermost_visit_about_them(loop_log: Path) -> None:
    with Run(loop_log) as run:
        spans = item_spans(run.visits)
    assert [(span.item, span.first, span.last, span.outcome) for span in spans] == [
        ("a", 1, 5, "SUCCESS"),
        ("b", 6, 8, "FAILURE"),
    ]


WORK = "Main/ForEach/Sequence"


@pytest.mark.parametrize(
    ("nodes", "script", "expected"),
    [
        (
            LOOP,
            {
                0: [begins("Main"), begins("Main/ForEach")],
                1: [BlackboardWrite("Main/item", "a", "Main/ForEach"), begins(WORK), begins(GRASP, "a")],
                3: [ends(GRASP, "FAILURE", "grasp.missed"), begins(GRASP, "a")],
                5: [ends(GRASP), ends(WORK)],
            },
            [(1, 5, "SUCCESS")],
        ),
        (
            tree("Main", "Main/Grasp", "Main/Place"),
            {
                0: [begins("Main"), begins("Main/Grasp", "a")],
                1: [ends("Main/Grasp"), begins("Main/Place", "a")],
                2: [ends("Main/Place"), begins("Main/Grasp", "a")],
                4: [ends("Main/Grasp", "FAILURE", "grasp.missed")],
            },
            [(0, 2, "SUCCESS"), (2, 4, "FAILURE")],
        ),
    ],
    ids=["a second try is no band of its own", "the next round is another band"],
)
def test_work_on_an_item_is_one_band(
    tmp_path: Path, nodes: Tree, script: Mapping[int, Sequence[Said]], expected: list[tuple[int, int, str]]
) -> None:
    with Run(record(tmp_path / "log.mcap", nodes, 7, script)) as run:
        spans = item_spans(run.visits)
    assert [(span.first, span.last, span.outcome) for span in spans] == expected


def test_statuses_are_those_of_every_tick(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        packed = data(pack_tree(run))
        statuses = packed["statuses"]
        assert statuses.shape == (len(packed["paths"]), len(run.ticks))
        for tick in run.ticks:
            nodes = tick.record.nodes
            assert [STATUSES[code] for code in statuses[:, tick.number]] == [node.status for node in nodes]
            ticked = tick_table(run).codes[:, tick.number] >= TICKED
            assert ticked.tolist() == [node.ticked for node in nodes]
        lanes = data(pack_lanes(run))
        assert [node["path"] for node in lanes["nodes"]] == packed["paths"]
        assert len(lanes["visits"]["node"]) == len(run.visits)
        assert lanes["outcomes"] == list(OUTCOMES)
        assert {mark["kind"] for mark in lanes["marks"]} == {"recovery", "fault", "item_done"}
        assert {item["colour"] for item in lanes["items"]} <= {"red", "green", "blue"}


def test_the_chart_is_that_of_the_recorded_mission(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        (drawn,) = data(pack_tree(run))["charts"]
    assert drawn["since"] == 0.0
    assert drawn["chart"]["order"] == ["Main", "SortOne"]
    assert "when grasp.missed" in str(drawn["chart"]["trees"]["SortOne"])


def test_without_a_mission_that_can_be_read_the_tree_is_drawn_as_recorded(loop_log: Path) -> None:
    with Run(loop_log) as run:
        (drawn,) = data(pack_tree(run))["charts"]
    assert drawn["chart"]["order"] == ["Main"]
    root = drawn["chart"]["trees"]["Main"]["root"]
    assert (root["id"], root["meaning"]) == ("ForEach", "loop")
    (sequence,) = root["children"]
    assert [(node["id"], node["meaning"]) for node in sequence["children"]] == [
        ("Grasp", "action"),
        ("Place", "action"),
    ]


def test_a_mission_that_is_not_the_one_that_ran_is_not_drawn(tmp_path: Path) -> None:
    other = "picktree: 1\nkind: mission\nname: other\ntrees:\n  Main:\n    Sequence:\n      - AlwaysSuccess\n"
    log = record(tmp_path / "log.mcap", LOOP, 2, {0: [begins("Main")]}, files={"mission.yaml": other})
    with Run(log) as run:
        (drawn,) = data(pack_tree(run))["charts"]
    assert drawn["chart"]["trees"]["Main"]["root"]["id"] == "ForEach"
    assert parse_mission(other, tmp_path / "mission.yaml").name == "other"


def test_an_edited_mission_has_a_chart_for_each_of_its_trees(edited: Path) -> None:
    with Run(edited) as run:
        charts = data(pack_tree(run))["charts"]
        assert [chart["since"] for chart in charts] == [at.time for at in run.trees]
        before, after = (str(chart["chart"]["trees"]["Part"]) for chart in charts)
        assert "edited" not in before
        assert "edited" in after
        table = tick_table(run)
        number = next(k for k, node in enumerate(table.nodes) if node.path.endswith("Log#2"))
        taken_over = run.ticks.number_at(run.trees[1].time)
        assert (table.statuses[number, :taken_over] == ABSENT).all()
        assert (table.statuses[number, taken_over:] != ABSENT).all()


def test_ticks_that_cannot_be_read_are_one_clear_error(loop_log: Path, monkeypatch: Any) -> None:
    with Run(loop_log) as run:
        assert len(run.trees) == 1

        class Broken:
            topic, time, data = "/bt/tick", 50_000_000, b'{"nodes": 3}'

        def messages(*_: object) -> list[type[Broken]]:
            return [Broken]

        monkeypatch.setattr(run.log, "messages", messages)
        with pytest.raises(PicktreeError, match=r"/bt/tick at 0\.05 s: unreadable message: "):
            tick_table(run)


def test_a_sub_tree_is_described_with_its_true_file(tmp_path: Path) -> None:
    mission = tmp_path / "m.yaml"
    mission.write_text(
        "picktree: 1\nkind: mission\nscene: sort_small\ninclude: [library/recovery]\n"
        "trees: {Main: {PutDown: {_skipIf: true}}}\n"
    )
    result = Session(RunRequest(mission, backend="kinematic", out=tmp_path / "runs")).run()
    with Run(result.log) as run:
        (drawn,) = data(pack_tree(run))["charts"]
    said = drawn["chart"]["trees"]["Main"]["root"]["doc"]
    assert said.startswith("Put what is held down on the table, ")
    assert " Defined at library/recovery:" in said

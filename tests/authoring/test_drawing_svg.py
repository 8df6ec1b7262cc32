"""The picture as SVG: nothing overlaps, no text is cut, and the file stands on its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest

from picktree.authoring import chart, chart_of_file, svg
from picktree.authoring.tree_layout import (
    COLUMN_GAP,
    FRAME_GAP,
    ROW_GAP,
    BoxPosition,
    LayoutBox,
    NodeCard,
    TreeFrame,
    expanded,
    frame_of,
    lay_out_boxes,
    page,
    width,
    wrapped,
)
from picktree.trees import NodeStatus

from ..trees.scripted import mission
from .drawn import SHIFT, Rect, outside, overlaps, shift

TAG = "{http://www.w3.org/2000/svg}"
SIZES = {"id": (12.0, "bold"), "name": (12.0, "regular"), "key": (11.0, "regular"), "doc": (11.0, "regular")}


def tiles(frame: TreeFrame) -> Iterator[Rect]:
    """The body of each node and its label, in the frame's coordinates."""
    for tile in frame.tiles:
        yield tile.body_x, tile.body_y, tile.body.width, tile.body.height
        if tile.pill:
            yield tile.x, tile.y, tile.pill.width, tile.pill.height


def frames(frame: TreeFrame) -> Iterator[TreeFrame]:
    yield frame
    for tile in frame.tiles:
        if isinstance(tile.body, TreeFrame):
            yield from frames(tile.body)


@pytest.mark.parametrize("expand", [False, True])
def test_nothing_overlaps_in_a_picture_of_200_nodes(expand: bool) -> None:
    assert shift().size == 200
    drawn = frames(expanded(shift())) if expand else map(frame_of, shift().trees)
    count = 0
    for frame in drawn:
        rects = list(tiles(frame))
        below = (0, frame.header.height, frame.width, frame.height - frame.header.height)
        assert outside(below, rects) == [], frame.tree.name
        assert overlaps(rects) == [], frame.tree.name
        count += len(frame.tiles)
    assert count == (200 if not expand else written_out("Main"))


def written_out(name: str) -> int:
    """Nodes of a tree, and below each call those of the called tree."""
    nodes = list(shift().tree(name).root.iterate())
    return len(nodes) + sum(written_out(node.calls) for node in nodes if node.calls)


def test_texts_fit_into_their_cards() -> None:
    cards = [tile.body for tree in shift().trees for tile in frame_of(tree).tiles]
    assert len(cards) == 200
    for body in cards:
        assert isinstance(body, NodeCard)
        for line in (*body.head, *body.lines):
            for span in line.spans:
                size, face = SIZES.get(span.look, (11.0, "mono"))
                left = 9 if line in body.lines else 30
                assert left + span.x + width(span.text, size, face) <= body.width, (body.node, span)  # type: ignore[arg-type]


def test_children_stand_in_order_and_in_the_next_column() -> None:
    boxes = [
        LayoutBox(100, 60, None),
        LayoutBox(50, 24, 0),
        LayoutBox(80, 40, 0),
        LayoutBox(120, 90, 0),
        LayoutBox(60, 24, 2),
    ]
    spots = lay_out_boxes(boxes)
    assert spots[0].x == 0
    assert {spots[1].x, spots[2].x, spots[3].x} == {100 + COLUMN_GAP}
    assert spots[4].x == 100 + COLUMN_GAP + 120 + COLUMN_GAP
    assert spots[1].y == 0
    assert spots[2].y >= 24 + ROW_GAP
    assert spots[3].y >= spots[2].y + 40 + ROW_GAP
    assert spots[4].y + 12 == spots[2].y + 20, "an only child stands level with its parent"


def test_a_page_has_the_shape_of_a_screen() -> None:
    assert page([(600, 400)]).spots == (BoxPosition(0, 0),)
    four = page([(600, 400)] * 4)
    assert four.spots == (
        BoxPosition(0, 0),
        BoxPosition(600 + FRAME_GAP, 0),
        BoxPosition(0, 400 + FRAME_GAP),
        BoxPosition(600 + FRAME_GAP, 400 + FRAME_GAP),
    )
    assert (four.width, four.height) == (1200 + FRAME_GAP, 800 + FRAME_GAP)


def test_picture_of_200_nodes_has_a_sensible_size() -> None:
    root = ET.fromstring(svg(shift()))
    assert 2000 < int(root.attrib["width"]) < 4500
    assert 1500 < int(root.attrib["height"]) < 3500


def test_text_wider_than_a_card_is_broken_at_spaces_and_ends_in_an_ellipsis() -> None:
    assert wrapped("a" * 30, 60.0, 10.0, "mono") == ("a" * 9, "a" * 9, "a" * 8 + "…")
    assert wrapped("one two three", 48.0, 10.0, "mono") == ("one two", "three")
    assert wrapped("", 48.0, 10.0) == ("",)
    assert width("日本", 10.0) == 20.0


def groups(text: str, look: str) -> list[ET.Element]:
    return [g for g in ET.fromstring(text).iter() if look in g.attrib.get("class", "").split()]


def test_picture_has_each_node_once_with_its_tooltip() -> None:
    found = groups(svg(shift()), "node")
    assert len(found) == 200
    grasp = next(g for g in found if g.attrib["data-path"] == "SortOne/Recover/Sequence/Grasp")
    title = grasp.findtext(f"{TAG}title") or ""
    assert title.startswith("Grasp (action)\n")
    assert re.search(r"^object: \{item\} – \S.* \(object\)$", title, re.MULTILINE)
    assert re.search(r"^may fail with .*grasp\.slipped", title, re.MULTILINE)
    assert "breakpoint: before" in title
    assert title.endswith("shift.yaml:94")
    texts = ["".join(t.itertext()) for t in grasp.iter(f"{TAG}text")]
    assert texts == ["Grasp", "_failureIf stopped", "object: {item}", "force: {force}"]
    assert [t.text for t in grasp.iter(f"{TAG}tspan") if t.attrib["class"] == "reference"] == [
        "{item}",
        "{force}",
    ]


def test_recovery_has_edges_and_labels_of_its_own() -> None:
    text = svg(shift())
    edges = [
        g.attrib["class"]
        for g in ET.fromstring(text).iter(f"{TAG}path")
        if "d" in g.attrib and "class" in g.attrib
    ]
    cures = sum(1 for t in shift().trees for n in t.root.iterate() for b in n.branches if b.role == "cure")
    assert edges.count("edge cure") == cures == 25
    labels = ["".join(g.itertext()) for g in groups(text, "pill") if "cure" in g.attrib["class"]]
    assert {"when grasp.slipped", "otherwise", "give_up", "recovery"} <= set(labels)
    assert ".drawing .edge.cure { stroke-dasharray: 5 3; }" in text


def test_calls_lead_to_the_trees_that_they_call() -> None:
    text = svg(shift())
    ids = set(re.findall(r' id="(tree-\w+)"', text))
    assert ids == {f"tree-{tree.name}" for tree in shift().trees}
    links = re.findall(r'<a href="#([^"]+)"', text)
    calls = [node.calls for tree in shift().trees for node in tree.root.iterate() if node.calls]
    assert sorted(links) == sorted(f"tree-{name}" for name in calls)
    assert set(links) < ids
    assert "<a " not in svg(shift(), expand=True)


def test_file_needs_nothing_from_elsewhere() -> None:
    text = svg(shift())
    assert not re.search(r"(?:src|href|url)\s*[=(]\s*[\"']?(?!#|\")", text)
    assert "@import" not in text
    assert "@media (prefers-color-scheme: dark)" in text


def test_texts_cannot_leave_their_places() -> None:
    found = svg(
        chart(mission("Main: {Log: {name: \"<b>&amp;\\uFFFE\", message: '</text><script>x</script>'}}"))
    )
    root = ET.fromstring(found)
    assert [e.tag for e in root.iter() if e.tag.endswith("script")] == []
    assert "Log<b>&amp;\ufffd" in "".join(root.itertext()).replace(" ", "")


def test_statuses_colour_the_nodes_of_the_running_tree() -> None:
    body = "Main: {Sequence: [One, One, AlwaysSuccess]}\nOne: {Fallback: [AlwaysFailure, AlwaysSuccess]}"
    statuses = {
        "Main": NodeStatus.RUNNING,
        "Main/Sequence/One": NodeStatus.SUCCESS,
        "Main/Sequence/One/Fallback/AlwaysFailure": NodeStatus.FAILURE,
        "Main/Sequence/One#2": NodeStatus.RUNNING,
        "Main/Sequence/AlwaysSuccess": NodeStatus.SKIPPED,
    }
    text = svg(chart(mission(body)), expand=True, statuses=statuses)
    frames_ = [g.attrib["class"] for g in groups(text, "frame")]
    assert frames_ == ["frame running", "frame called success", "frame called running"]
    looks = {g.attrib["data-path"]: g.attrib["class"] for g in groups(text, "node")}
    assert looks["Main/Sequence/One/Fallback/AlwaysFailure"] == "node action failure"
    assert looks["Main/Sequence/One#2/Fallback/AlwaysFailure"] == "node action"
    assert looks["Main/Sequence/AlwaysSuccess"] == "node action skipped"


def test_a_machine_without_fonts_says_nothing_and_draws_the_same(tmp_path: Path) -> None:
    program = f"""
from pathlib import Path
from picktree.authoring import chart_of_file
from picktree.authoring import svg
print(svg(chart_of_file(Path({str(SHIFT)!r}))), end="")
"""
    nowhere = {"FONTCONFIG_FILE": str(tmp_path / "none"), "FONTCONFIG_PATH": str(tmp_path)}
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env={**os.environ, **nowhere}
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout == svg(shift())


def test_the_picture_of_the_readme_is_of_the_example_as_it_is() -> None:
    root = Path(__file__).parents[2]
    drawn = svg(chart_of_file(root / "examples" / "sort_by_colour.yaml"))
    shown = (root / "docs" / "tree.svg").read_text(encoding="utf-8")
    assert shown == drawn, "picktree render examples/sort_by_colour.yaml -o docs/tree.svg"

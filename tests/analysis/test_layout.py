"""The layout, judged by Lichtblick's own rules: its grammar, its parser of schemas, its camera."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.json_format import MessageToDict

from picktree.analysis import Run
from picktree.analysis.export import layout
from picktree.analysis.export.viewer_layout import MAX_LEAF_LANES, ViewerLayout, aim_camera, lanes, literal
from picktree.logs import RunLog, topics

GOLDEN = Path(__file__).parents[1] / "logs" / "golden"


@pytest.fixture(scope="module")
def made(troubled_log: Path) -> ViewerLayout:
    with Run(troubled_log) as run:
        return layout(run)


def paths_of(panel: Mapping[str, Any]) -> list[str]:
    """Return the message paths that a panel shows, without whole topics."""
    return [path["value"] for path in panel.get("paths", [])] or [panel[k] for k in panel if k == "topicPath"]


PART = re.compile(r"\.(\w+)|\[(\d+|:)\]|\{(\w+)==(?:\"([^\"]*)\"|'([^']*)')\}")
"""Part of a message path, as far as the layout uses the grammar: a field, an element or all, a filter."""


def values(path: str, message: Any) -> list[Any]:
    """Return the values that a panel shows of a message of the path's topic."""
    topic = re.match(r"[/\w]+", path)
    assert topic, path
    found, at = [message], topic.end()
    while at < len(path):
        part = PART.match(path, at)
        assert part, f"{path}: {path[at:]}"
        field, element, key, double, single = part.groups()
        if field:
            found = [value[field] for value in found if field in value]
        elif element:
            found = [each for value in found for each in (value if element == ":" else [value[int(element)]])]
        else:
            found = [value for value in found if value.get(key) == (single if double is None else double)]
        at = part.end()
    return found


def messages(log: RunLog, topic: str) -> Iterator[object]:
    """Yield a topic's messages as a viewer has them: JSON parsed, protobuf with all of its fields."""
    for raw in log.messages([topic]):
        if log.topics[topic].encoding == "json":
            yield json.loads(raw.data)
        else:
            from foxglove_schemas_protobuf.JointStates_pb2 import JointStates

            assert topic == topics.JOINTS.name
            message = JointStates.FromString(raw.data)
            yield MessageToDict(
                message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
            )


def test_every_message_path_finds_something_in_the_log(troubled_log: Path, made: ViewerLayout) -> None:
    empty: list[str] = []
    with RunLog(troubled_log) as log:
        for key, panel in made.panels.items():
            for text in paths_of(panel):
                topic = re.split(r"[.{\[]", text)[0]
                assert topic in log.topics, text
                if not any(values(text, message) for message in messages(log, topic)):
                    empty.append(f"{key} {text}")
    assert empty == []


def test_a_lane_shows_statuses_alone(troubled_log: Path, made: ViewerLayout) -> None:
    paths = [t for t in paths_of(made.panels["StateTransitions!tree"]) if t.startswith("/bt/tick.")]
    assert len(paths) > 5
    with RunLog(troubled_log) as log:
        for message in messages(log, topics.TICK.name):
            for text in paths:
                assert {*values(text, message)} <= {"IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"}


def test_lanes_are_the_root_and_what_took_time_in_the_trees_order(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        chosen = lanes(run)
        order = [node.path for node in run.trees[0].record.nodes]
        idle = {n.path for n in run.trees[0].record.nodes} - {visit.path for visit in run.visits}
    assert list(chosen.values()) == [
        "Main",
        "Repeat/Sequence",
        "Sequence/Observe",
        "ForEach",
        "SortOne",
        "Recover/Sequence",
        "Grasp",
        "Place",
        "grasp.missed",
        "grasp.missed/SafeRetreat",
        "grasp.missed/Observe",
        "world.unknown_object/Observe",
        "give_up/SafeRetreat",
        "GoTo",
        "Push",
    ]
    assert all(path.endswith(label) for path, label in chosen.items())
    paths = list(chosen)
    assert paths == sorted(paths, key=order.index)
    assert idle and not idle & set(paths)
    assert len(chosen) <= MAX_LEAF_LANES + 6


def test_the_arrangement_holds_every_panel_once(made: ViewerLayout) -> None:
    def leaves(node: str | Mapping[str, Any]) -> Iterator[str]:
        if not isinstance(node, str):
            assert 0 < node["splitPercentage"] < 100
            yield from leaves(node["first"])
            yield from leaves(node["second"])
            return
        yield node
        panel = made.file["configById"][node]
        if "tabs" in panel:
            assert 0 <= panel["activeTabIdx"] < len(panel["tabs"])
            for tab in panel["tabs"]:
                yield from leaves(tab["layout"])

    placed = list(leaves(made.file["layout"]))
    assert sorted(placed) == sorted(made.file["configById"])
    kinds = {key.split("!")[0] for key in placed}
    assert kinds == {"3D", "StateTransitions", "Plot", "RawMessages", "Image", "RosOut", "Tab"}


def test_the_topics_of_the_panels_are_those_of_the_log(troubled_log: Path, made: ViewerLayout) -> None:
    panels = made.panels
    with RunLog(troubled_log) as log:
        for key, panel in panels.items():
            if key.startswith("3D!"):
                assert set(panel["topics"]) <= set(log.topics)
                frames = {f"frame:{t.child}" for at in log.transforms() for t in at.record}
                assert set(panel["transforms"]) == {"frame:world", *frames}
            if key.startswith("Image!"):
                assert {panel["imageMode"]["imageTopic"], panel["imageMode"]["calibrationTopic"]} <= set(
                    log.topics
                )
        assert log.topics[panels["RosOut!log"]["topicToRender"]].schema == "foxglove.Log"


def test_the_camera_sees_all_of_a_sphere(made: ViewerLayout) -> None:
    centre, radius = np.array([0.3, -0.1, 0.4]), 0.7
    state = dict(made.panels["3D!belief"]["cameraState"])
    aim_camera(state, centre, radius)
    # three.js: Spherical(distance, phi, theta) about y, turned by 90 degrees about x
    phi, theta = math.radians(state["phi"]), -math.radians(state["thetaOffset"])
    x, y, z = math.sin(phi) * math.sin(theta), math.cos(phi), math.sin(phi) * math.cos(theta)
    eye = np.array(state["targetOffset"]) + state["distance"] * np.array([x, -z, y])
    away = float(np.linalg.norm(eye - centre))
    towards = (eye - centre) / away
    assert math.degrees(math.atan2(towards[1], towards[0])) == pytest.approx(-30.0)  # before the robot
    assert math.degrees(math.asin(towards[2])) == pytest.approx(25.0)
    half = math.degrees(math.asin(radius / away))
    assert 0.8 * state["fovy"] / 2 < half < state["fovy"] / 2


def refused(schema: dict[str, Any], where: str = "") -> list[str]:
    """Return the errors that Lichtblick's reader of JSON schemas raises (its `parseJsonSchema.ts`)."""
    if schema.get("type") != "object" or not isinstance(schema.get("properties"), dict):
        return [f"{where}: no object with properties"]
    found: list[str] = []
    for name, field in schema["properties"].items():
        at = f"{where}.{name}"
        kind = "alternatives" if "oneOf" in field else field.get("type")
        if kind == "array":
            field = field["items"]
            kind = field.get("type")
        if kind == "object":
            found += refused(field, at)
        elif kind not in ("boolean", "string", "number", "integer"):
            found.append(f"{at}: {kind}")
    return found


@pytest.mark.parametrize("topic", [t for t in topics.FIXED if t.encoding == "json"], ids=lambda t: t.name)
def test_lichtblick_reads_the_schema(topic: topics.Topic) -> None:
    assert refused(json.loads(topic.schema_data())) == []


def test_what_lichtblick_refuses_is_seen() -> None:
    schema = {
        "type": "object",
        "properties": {
            "any": {},
            "free": {"type": "object"},
            "path": {"type": "array", "items": {"type": "array", "items": {"type": "number"}}},
        },
    }
    assert refused(schema) == [".any: None", ".free: no object with properties", ".path: array"]


def test_a_log_of_an_older_format_has_a_layout() -> None:
    with Run(GOLDEN / "format-2.mcap") as run:
        paths = paths_of(layout(run).panels["StateTransitions!tree"])
    assert paths == [
        "/bt/tick.root_status",
        '/bt/tick.nodes[:]{path=="/Main"}.status',
        '/bt/tick.nodes[:]{path=="/Main/Grasp"}.status',
        '/events{kind=="recovery"}.message',
    ]


def test_a_log_that_was_cut_has_a_layout(troubled_log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = troubled_log.read_bytes()
    cut.write_bytes(data[: len(data) * 3 // 4])
    with Run(cut) as run:
        assert run.recovered
        kinds = {key.split("!")[0] for key in layout(run).panels}
    assert {"3D", "StateTransitions", "Plot", "RosOut"} <= kinds


def test_a_text_with_both_quotes_cannot_be_filtered_by() -> None:
    assert literal("Main/Grasp") == '"Main/Grasp"'
    assert literal('say "hi"') == "'say \"hi\"'"
    assert literal('"it\'s"') is None

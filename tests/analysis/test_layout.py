"""The layout, judged by Lichtblick's own rules: its grammar, its parser of schemas."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.json_format import MessageToDict

from picktree.analysis import Run
from picktree.analysis.export import LAYOUT_FILE
from picktree.analysis.export.rerun_recording import MAX_LEAF_LANES, shown_nodes
from picktree.logs import RunLog, topics

LAYOUT: dict[str, Any] = json.loads(LAYOUT_FILE.read_text(encoding="utf-8"))
PANELS = {key: panel for key, panel in LAYOUT["configById"].items() if not key.startswith("Tab!")}
RARE = ("safety_stop", "mission_edited")
"""Kinds of event that the log of the tests does not have."""


def paths_of(panel: Mapping[str, Any]) -> list[str]:
    """Return the message paths that a panel shows, without whole topics."""
    return [path["value"] for path in panel.get("paths", [])] or [panel[k] for k in panel if k == "topicPath"]


PART = re.compile(r"\.(\w+)|\[(\d+|:)\]|\{(\w+)==(?:\"([^\"]*)\"|\$(\w+))\}")
"""Part of a message path, as far as the layout uses the grammar: a field, an element or all, a filter by a
text or by a variable."""


def values(path: str, message: Any) -> list[Any]:
    """Return the values that a panel shows of a message of the path's topic."""
    topic = re.match(r"[/\w]+", path)
    assert topic, path
    found, at = [message], topic.end()
    while at < len(path):
        part = PART.match(path, at)
        assert part, f"{path}: {path[at:]}"
        field, element, key, text, variable = part.groups()
        if field:
            found = [value[field] for value in found if field in value]
        elif element:
            found = [each for value in found for each in (value if element == ":" else [value[int(element)]])]
        else:
            wanted = text if variable is None else LAYOUT["globalVariables"][variable]
            found = [value for value in found if value.get(key) == wanted]
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


def test_every_message_path_finds_something_in_the_log(troubled_log: Path) -> None:
    empty: list[str] = []
    with RunLog(troubled_log) as log:
        for key, panel in PANELS.items():
            for text in paths_of(panel):
                topic = re.split(r"[.{\[]", text)[0]
                assert topic in log.topics, text
                if not any(values(text, message) for message in messages(log, topic)):
                    empty.append(f"{key} {text}")
    assert empty == [f'StateTransitions!tree /events{{kind=="{kind}"}}.message' for kind in RARE]


def test_a_lane_shows_statuses_alone(troubled_log: Path) -> None:
    paths = [t for t in paths_of(PANELS["StateTransitions!tree"]) if t.startswith("/bt/tick.")]
    assert len(paths) == 2
    with RunLog(troubled_log) as log:
        for message in messages(log, topics.TICK.name):
            for text in paths:
                assert {*values(text, message)} <= {"IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"}


def test_lanes_in_rerun_are_the_root_and_what_took_time_in_the_trees_order(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        paths = list(shown_nodes(run))
        order = [node.path for node in run.trees[0].record.nodes]
        idle = {n.path for n in run.trees[0].record.nodes} - {visit.path for visit in run.visits}
    assert [path.split("/")[-1] for path in paths] == [
        "Main",
        "Sequence",
        "Observe",
        "ForEach",
        "SortOne",
        "Sequence",
        "Grasp",
        "Place",
        "grasp.missed",
        "SafeRetreat",
        "Observe",
        "Observe",
        "SafeRetreat",
        "GoTo",
        "Push",
    ]
    assert paths == sorted(paths, key=order.index)
    assert idle and not idle & set(paths)
    assert len(paths) <= MAX_LEAF_LANES + 6


def test_the_arrangement_holds_every_panel_once() -> None:
    def leaves(node: str | Mapping[str, Any]) -> Iterator[str]:
        if not isinstance(node, str):
            assert 0 < node["splitPercentage"] < 100
            yield from leaves(node["first"])
            yield from leaves(node["second"])
            return
        yield node
        panel = LAYOUT["configById"][node]
        if "tabs" in panel:
            assert 0 <= panel["activeTabIdx"] < len(panel["tabs"])
            for tab in panel["tabs"]:
                yield from leaves(tab["layout"])

    placed = list(leaves(LAYOUT["layout"]))
    assert sorted(placed) == sorted(LAYOUT["configById"])
    kinds = {key.split("!")[0] for key in placed}
    assert kinds == {"3D", "StateTransitions", "Plot", "RawMessages", "Image", "RosOut", "Tab"}


def test_the_topics_of_the_panels_are_those_of_logs(troubled_log: Path) -> None:
    with RunLog(troubled_log) as log:
        known = {name.replace(f"/{camera}/", "/CAMERA/") for name in log.topics for camera in log.cameras}
        log_schema = log.topics[PANELS["RosOut!log"]["topicToRender"]].schema
    used = [name for key, panel in PANELS.items() if key.startswith("3D!") for name in panel["topics"]]
    used += [
        name
        for key, panel in PANELS.items()
        if key.startswith("Image!")
        for name in panel["imageMode"].values()
    ]
    assert {re.sub("/(overhead|wrist)/", "/CAMERA/", name) for name in used} <= known
    assert log_schema == "foxglove.Log"


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

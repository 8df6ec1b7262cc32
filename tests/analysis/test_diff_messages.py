"""The first message in which two logs differ: bytes first, the field by name."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from picktree.analysis import Run
from picktree.analysis.compare import first_difference
from picktree.analysis.compare.message_differences import (
    FieldDifference,
    MessageDifference,
    first_difference_in_values,
    first_differing_field,
)
from picktree.logs.log_records import BodyRecord, Joints, Scene
from picktree.logs.recording import Recorder, foxglove_messages
from picktree.logs.recording.foxglove_messages import SceneMessages, encode_image
from picktree.world import Pose, Sphere, Tick, Wrench

from ..logs.scripted_log import begins, ends, record, tree

NODES = tree("Main:Sequence", "Main/Grasp", "Main/Place")


def compared(
    a: Path, b: Path, since: float | None = None, until: float | None = None
) -> MessageDifference | None:
    with Run(a) as one, Run(b) as other:
        return first_difference(one, other, since=since, until=until)


def test_the_same_simulation_in_other_chunks_does_not_differ(sample: ModuleType, tmp_path: Path) -> None:
    sample.record(tmp_path / "a.mcap")
    sample.record(tmp_path / "b.mcap", chunk_bytes=2000, wall_time=0.01)
    assert (tmp_path / "a.mcap").read_bytes() != (tmp_path / "b.mcap").read_bytes()
    assert compared(tmp_path / "a.mcap", tmp_path / "b.mcap") is None


def test_a_field_of_a_json_topic_is_named(tmp_path: Path) -> None:
    script = {0: [begins("Main"), begins("Main/Grasp")]}
    a = record(tmp_path / "a.mcap", NODES, 9, {**script, 6: [ends("Main/Grasp")]})
    b = record(tmp_path / "b.mcap", NODES, 9, {**script, 6: [ends("Main/Grasp", "FAILURE")]})
    expected = MessageDifference(
        6, 0.3, "/bt/tick", "", False, "transitions[0].status", "Main/Grasp", "SUCCESS", "FAILURE"
    )
    assert compared(a, b) == expected
    assert compared(a, b, until=0.25) is None
    assert compared(a, b, since=0.35) is None


def test_a_field_of_a_protobuf_topic_is_named() -> None:
    a, b = (
        foxglove_messages.JointMessages().encode(
            50_000_000, Joints(("j1", "j2"), (0.5, x), (0.0, 0.0), (0.0, 0.0))
        )
        for x in (1.0, 1.5)
    )
    assert first_differing_field("foxglove.JointStates", a, b) == FieldDifference(
        "joints[1].position", "j2", 1.0, 1.5
    )


def test_a_record_in_the_metadata_of_an_entity_is_looked_into() -> None:
    bodies = (
        BodyRecord("ball", "sphere", Sphere(0.02), "red", Pose(), id="red_ball_1", place=place)
        for place in ("table", "red_bin")
    )
    a, b = (SceneMessages(locked=True).encode(0, Scene((body,), ())) for body in bodies)
    found = first_differing_field("foxglove.SceneUpdate", a, b)
    assert found == FieldDifference("entities[0].metadata[2].value", "place", "table", "red_bin")


def test_bytes_are_told_by_their_length() -> None:
    a, b = (encode_image(0, "camera", "png", data) for data in (b"abc", b"abcd"))
    found = first_differing_field("foxglove.CompressedImage", a, b)
    assert found == FieldDifference("data", "", "3 bytes, CRC-32 352441c2", "4 bytes, CRC-32 ed82cd11")


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ({"x": 1}, {"x": 1.0}, FieldDifference("x", "", 1, 1.0)),
        ({"x": 1}, {"x": True}, FieldDifference("x", "", 1, True)),
        ({"x": [1, 2]}, {"x": [1]}, FieldDifference("x[1]", "", 2, None)),
        ({"x": None}, {}, None),
        ({}, {"y": {"z": 3}}, FieldDifference("y", "", None, {"z": 3})),
        ({"v": '{"a": 1, "b": 2}'}, {"v": '{"a": 1, "b": 3}'}, FieldDifference("v.b", "", 2, 3)),
        ({"v": '{"a'}, {"v": '{"b'}, FieldDifference("v", "", '{"a', '{"b')),
        ([{"id": "p", "w": [{"q": 1}]}], [{"id": "p", "w": [{"q": 2}]}],
         FieldDifference("[0].w[0].q", "p", 1, 2)),
    ],
)  # fmt: skip
def test_values_are_compared_as_json_has_them(a: object, b: object, expected: FieldDifference | None) -> None:
    assert first_difference_in_values(a, b) == expected


def test_undecodable_bytes_differ_as_a_whole() -> None:
    assert first_differing_field("picktree.Wrench", b"{", b"{}") == FieldDifference(
        "", "", "1 bytes", "2 bytes"
    )


def test_the_log_that_ends_first_is_named(tmp_path: Path) -> None:
    script = {0: [begins("Main")]}
    a = record(tmp_path / "a.mcap", NODES, 9, script)
    b = record(tmp_path / "b.mcap", NODES, 4, script)
    ended = compared(a, b)
    assert ended == MessageDifference(4, 0.2, "/bt/tick", "b", True, "", "", None, None)
    mirrored = compared(b, a)
    assert mirrored is not None and (mirrored.missing, mirrored.ended, mirrored.tick) == ("a", True, 3)


def test_a_message_that_only_one_side_has_is_named(sample: ModuleType, tmp_path: Path) -> None:
    for name, extra in (("a", False), ("b", True)):
        with Recorder(tmp_path / f"{name}.mcap", sample.RUN) as recorder:
            for k in range(4):
                if extra and k == 2:
                    recorder.log(0.1, "INFO", "here", "Main")
                recorder.tick(k * 0.05, Tick("RUNNING", "", ()))
                recorder.wrench(k * 0.05, Wrench((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    line = {
        "timestamp": "1970-01-01T00:00:00.100Z", "level": "INFO", "message": "here", "name": "Main",
        "file": "", "line": 0,
    }  # fmt: skip
    found = compared(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert found == MessageDifference(2, 0.1, "/log", "a", False, "", "", None, line)
    found = compared(tmp_path / "b.mcap", tmp_path / "a.mcap")
    assert found == MessageDifference(2, 0.1, "/log", "b", False, "", "", line, None)

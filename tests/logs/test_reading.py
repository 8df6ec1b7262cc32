"""What the recorder wrote comes back, in our reader and in the stock one."""

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import orjson
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader

from picktree.files import PicktreeError
from picktree.logs import RunLog, topics
from picktree.logs.log_files import find_log
from picktree.logs.mcap import reader
from picktree.logs.recording import Recorder
from picktree.world import Box, Cylinder, PlanningScene, Sphere

TABLE = {
    "/bt/tree": ("picktree.Tree", "json", "jsonschema"),
    "/bt/nodes": ("picktree.Nodes", "json", "jsonschema"),
    "/bt/tick": ("picktree.Tick", "json", "jsonschema"),
    "/timing": ("picktree.Timing", "json", "jsonschema"),
    "/joint_states": ("foxglove.JointStates", "protobuf", "protobuf"),
    "/tf": ("foxglove.FrameTransforms", "protobuf", "protobuf"),
    "/scene/robot": ("foxglove.SceneUpdate", "protobuf", "protobuf"),
    "/scene/objects": ("foxglove.SceneUpdate", "protobuf", "protobuf"),
    "/truth/objects": ("foxglove.SceneUpdate", "protobuf", "protobuf"),
    "/wrench": ("picktree.Wrench", "json", "jsonschema"),
    "/control": ("picktree.Control", "json", "jsonschema"),
    "/camera/overhead/colour": ("foxglove.CompressedImage", "protobuf", "protobuf"),
    "/camera/overhead/depth": ("foxglove.CompressedImage", "protobuf", "protobuf"),
    "/camera/overhead/calibration": ("foxglove.CameraCalibration", "protobuf", "protobuf"),
    "/plan": ("picktree.Plan", "json", "jsonschema"),
    "/candidates": ("picktree.Candidates", "json", "jsonschema"),
    "/log": ("foxglove.Log", "protobuf", "protobuf"),
    "/events": ("picktree.Event", "json", "jsonschema"),
}


def test_the_stock_reader_finds_every_topic_with_its_schema(log_path: Path) -> None:
    with log_path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        found = {
            channel.topic: (
                summary.schemas[channel.schema_id].name,
                channel.message_encoding,
                summary.schemas[channel.schema_id].encoding,
            )
            for channel in summary.channels.values()
        }
        assert found == TABLE
        counts: dict[str, int] = dict.fromkeys(TABLE, 0)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert message.log_time == message.publish_time
            if schema.encoding == "protobuf":
                files = FileDescriptorSet.FromString(schema.data)
                pool = DescriptorPool()
                for file in files.file:
                    pool.Add(file)
                kind = GetMessageClass(pool.FindMessageTypeByName(schema.name))
                decoded = kind.FromString(message.data)
                stamp: Any = getattr(decoded, "timestamp", None)
                if stamp is not None:
                    assert stamp.seconds * 10**9 + stamp.nanos == message.log_time
            else:
                assert set(json.loads(schema.data)["required"]) == set(json.loads(message.data))
            counts[channel.topic] += 1
        assert all(counts.values()), counts
        assert counts == {
            summary.channels[n].topic: count
            for n, count in summary.statistics.channel_message_counts.items()  # pyright: ignore
        }
        assert [a.name for a in reader.iter_attachments()] == ["mission.yaml"]
        assert {m.name for m in reader.iter_metadata()} == {
            "picktree",
            "picktree.parameters",
            "picktree.physics",
            "picktree.versions",
            "picktree.machine",
            "picktree.arithmetic",
            "picktree.files",
            "picktree.tree",
            "picktree.result",
        }


@pytest.mark.parametrize("name", ["format-2", "format-3"])
def test_a_golden_log_reads_as_it_always_did(sample: ModuleType, name: str) -> None:
    golden = json.loads((sample.GOLDEN / f"{name}.json").read_text())
    assert sample.told(sample.GOLDEN / f"{name}.mcap") == golden


def test_records_come_back_as_they_went_in(sample: ModuleType, log_path: Path) -> None:
    with RunLog(log_path) as log:
        assert log.run == sample.RUN
        assert log.recovered == ""
        ticks = list(log.ticks())
        assert [t.record for t in ticks] == [sample.tick(k) for k in range(60)]
        assert [t.time for t in ticks] == pytest.approx([k * 0.05 for k in range(60)])
        assert log.robot_model() == sample.MESHES
        belief = log.belief_at(0.2)
        assert belief is not None
        assert belief.time == 0.0
        assert [b.shape for b in belief.record.bodies] == [
            Box((0.04, 0.04, 0.04)), Cylinder(0.02, 0.08), Sphere(0.025), sample.WEDGE,
        ]  # fmt: skip
        assert [p.id for p in belief.record.fixed] == ["table", *(f"red_bin/{k}" for k in range(5))]
        shot = next(log.images("overhead")).record
        original = sample.image(0.0)
        assert shot.colour.shape == original.colour.shape
        np.testing.assert_allclose(shot.depth, original.depth, atol=0.00051)
        assert shot.intrinsics == original.intrinsics


def test_time_is_searched_inclusively(log_path: Path) -> None:
    with RunLog(log_path) as log:
        assert [t.time for t in log.ticks(1.0, 1.1)] == pytest.approx([1.0, 1.05, 1.1])
        found = log.tick_at(1.07)
        assert found is not None
        assert found.time == pytest.approx(1.05)
        assert log.tick_at(-1.0) is None


def test_a_failure_is_told_to_people_once_and_where_it_began(log_path: Path) -> None:
    with RunLog(log_path) as log:
        assert [(round(x.time, 2), x.record.level, x.record.name, x.record.message) for x in log.lines()] == [
            (1.5, "ERROR", "/Main/Grasp", "grasp.missed: the fingers closed at 0.4 mm"),
            (2.0, "WARNING", "/Main/Grasp", "SafeRetreat after grasp.missed"),
        ]


def test_belief_changes_are_events(log_path: Path) -> None:
    with RunLog(log_path) as log:
        messages = [e.record.message for e in log.events() if e.record.kind == "belief"]
    assert messages == [
        "red_block_1: seen",
        "green_block_2: seen",
        "blue_block_3: seen",
        "yellow_block_4: seen",
        "red_block_1: attached to the gripper",
        "blue_block_3: its place was seen empty",
    ]


def test_no_json_schema_refers_or_has_two_types() -> None:
    """Of what viewers read: the alternatives of events are beside it."""
    for topic in topics.FIXED:
        if topic.encoding == "json":
            schema = orjson.loads(topic.schema_data())
            assert schema["type"] == "object"
            assert ("oneOf" in schema) is (topic == topics.EVENTS)
            text = orjson.dumps({**schema, "oneOf": []}).decode()
            assert "$ref" not in text and "anyOf" not in text and '"type":[' not in text


def test_a_log_is_found_by_file_folder_and_last(
    log_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        PicktreeError, match=r"there is no run in .*/runs yet; `picktree run MISSION` makes one"
    ):
        find_log("last")
    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    (run / "log.mcap").write_bytes(log_path.read_bytes())
    assert find_log("last").absolute() == find_log(run) == find_log(run / "log.mcap")
    assert find_log(run.name).absolute() == find_log(run)
    with pytest.raises(PicktreeError) as raised:
        find_log(tmp_path)
    assert str(raised.value) == f"{tmp_path}: there is no log.mcap in this folder"
    with pytest.raises(PicktreeError) as raised:
        find_log(run.parent)
    assert str(raised.value) == (
        f"{run.parent}: there is no log.mcap in this folder; there are runs in it: name one, or run "
        f"`picktree explain {run.parent}` for all of them"
    )


def test_a_newer_format_is_refused_with_a_sentence(
    sample: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("picktree.logs.log_records.FORMAT", 4)
    path = tmp_path / "log.mcap"
    sample.record(path, ticks=2)
    with pytest.raises(PicktreeError) as raised:
        RunLog(path)
    assert str(raised.value) == (
        f"{path}: the log has format 4, and this picktree reads up to 3; upgrade picktree to read it"
    )


def test_a_log_that_grows_while_it_is_opened_is_read_as_it_was(
    sample: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.mcap"
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    check = reader._is_as_written  # pyright: ignore[reportPrivateUsage]
    grown: list[bool] = []
    with Recorder(path, sample.RUN) as recorder:
        sample.start(recorder)
        for k in range(60):
            sample.step(recorder, scene, k)

        def check_and_grow(*arguments: Any) -> bool:
            grown.append(check(*arguments))
            size = path.stat().st_size
            for k in range(60, 120):
                sample.step(recorder, scene, k)
            assert path.stat().st_size > size
            return grown[-1]

        monkeypatch.setattr(reader, "_is_as_written", check_and_grow)
        log = reader.McapReader(path)
        ticks = [message.time for message in log.messages({"/bt/tick"})]
        log.close()
    assert grown == [True]
    assert not log.recovered
    assert 0 < len(ticks) <= 60

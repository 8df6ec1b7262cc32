"""Logs that other MCAP tools have rewritten read as the original, or say what they lack."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
from mcap.reader import make_reader
from mcap.records import Metadata

from picktree.analysis import Run
from picktree.analysis.compare import diff, first_difference
from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.log_files import Rotation
from picktree.logs.log_records import FORMAT
from picktree.logs.recording import Recorder
from picktree.world import PlanningScene

from .rewriting import (
    EPOCH,
    ORDER,
    SECOND,
    WRITING,
    Content,
    Sent,
    jittered,
    with_record,
    without_attachment_sums,
)


def told(log: RunLog) -> dict[str, list[tuple[float, bytes]]]:
    """Times and contents of the messages by topic, without topics of other programs."""
    found: dict[str, list[tuple[float, bytes]]] = {}
    for message in log.messages():
        if log.topics[message.topic].schema.startswith(("picktree.", "foxglove.")):
            found.setdefault(message.topic, []).append((message.time / 1e9, message.data))
    found.pop("/image", None)
    return found


@cache
def told_of(path: Path) -> dict[str, list[tuple[float, bytes]]]:
    with RunLog(path) as log:
        return told(log)


def assert_reads_as(path: Path, original: Path) -> None:
    with RunLog(original) as one, RunLog(path) as other:
        assert other.recovered == ""
        assert told(other) == told_of(original)
        assert (other.run, other.result, other.metadata) == (one.run, one.result, one.metadata)
        assert other.attachment("mission.yaml") == one.attachment("mission.yaml")
        assert [at.time for at in other.images("overhead")] == [at.time for at in one.images("overhead")]
        assert {n: i.messages for n, i in one.topics.items() if i.messages}.items() <= {
            n: i.messages for n, i in other.topics.items()
        }.items()


@pytest.fixture(scope="module")
def content(log_path: Path) -> Content:
    return Content.of(log_path)


PAIRS = [*((form, None) for form in WRITING), *zip([*WRITING, *WRITING], ORDER, strict=False)]
"""Each form of a file, and each order with one of the forms: they do not depend on each other."""


@pytest.mark.parametrize(("form", "order"), PAIRS)
def test_a_rewritten_log_reads_as_the_original(
    log_path: Path, content: Content, tmp_path: Path, form: str, order: str | None
) -> None:
    ordered = ORDER[order](content) if order else content
    assert_reads_as(WRITING[form](ordered).write(tmp_path / "log.mcap"), log_path)


@pytest.mark.parametrize("opcode", [0x80, 0xFF])
@pytest.mark.parametrize("form", ["lz4", "plain"])
def test_records_of_other_programs_are_passed_over(
    log_path: Path, content: Content, tmp_path: Path, form: str, opcode: int
) -> None:
    rewritten = WRITING[form](content.with_options(chunk_size=4000)).write(tmp_path / "a.mcap")
    assert_reads_as(with_record(rewritten, opcode, b"anything", tmp_path / "log.mcap"), log_path)


def test_an_attachment_may_have_no_check_sum(log_path: Path, content: Content, tmp_path: Path) -> None:
    rewritten = WRITING["no sums"](content).write(tmp_path / "log.mcap")
    assert_reads_as(without_attachment_sums(rewritten), log_path)


@pytest.mark.parametrize("is_sorted", [False, True])
def test_late_messages_take_the_times_of_their_stamps(
    log_path: Path, content: Content, tmp_path: Path, *, is_sorted: bool
) -> None:
    """40 ms are nearly a tick: neighbouring ticks change places. The sample is not in the order of a run."""
    content = jittered(content, 40_000_000)
    in_order = sorted(content.messages, key=lambda sent: sent.time) if is_sorted else content.messages
    rewritten = content.ordered(in_order).write(tmp_path / "log.mcap")
    with RunLog(log_path) as one, RunLog(rewritten) as other:
        there, here = told(one), told(other)
        for topic in ("/bt/tick", "/joint_states", "/tf", "/wrench", "/control", "/scene/objects", "/log"):
            assert here[topic] == there[topic], topic
        for topic in there:
            assert [data for _, data in here[topic]] == [data for _, data in there[topic]], topic
            assert [t for t, _ in here[topic]] == pytest.approx([t for t, _ in there[topic]], abs=0.051)
    with Run(log_path) as one, Run(rewritten) as other:
        assert [(v.path, v.start, v.end) for v in other.visits] == [
            (v.path, v.start, v.end) for v in one.visits
        ]


def test_two_equal_messages_of_the_recorder_are_two(log_path: Path, content: Content, tmp_path: Path) -> None:
    """They have numbers of their own."""
    last = content.messages[-1]
    doubled = content.ordered([*content.messages, replace(last, sequence=last.sequence + 1)])
    one = doubled.write(tmp_path / "one.mcap")
    two = ORDER["twice"](doubled).write(tmp_path / "two.mcap")
    with RunLog(log_path) as log, RunLog(one) as log_one, RunLog(two) as log_two:
        assert len(told(log_one)[last.topic]) == len(told(log)[last.topic]) + 1
        assert told(log_two) == told(log_one)


def test_without_stamps_times_are_counted_from_the_first_tick(
    log_path: Path, content: Content, tmp_path: Path
) -> None:
    later = content.ordered(
        replace(sent, time=sent.time + EPOCH) for sent in content.messages if sent.encoding == "json"
    )
    with RunLog(log_path) as one, RunLog(later.write(tmp_path / "log.mcap")) as other:
        assert told(other)["/bt/tick"] == told(one)["/bt/tick"]
        assert "it lacks the topics /joint_states, /tf and /scene/objects" in other.recovered


def clipped(content: Content, start: float, end: float) -> Content:
    return content.ordered(sent for sent in content.messages if start <= sent.time / SECOND <= end)


@pytest.mark.parametrize(
    ("start", "end", "said"),
    [
        (0.0, 2.0, ""),
        (1.0, 9.0, "the log begins at 1.00 s: everything before is missing; it lacks the topic /bt/tree"),
    ],
)
def test_a_clipped_log_says_what_is_missing(
    log_path: Path, content: Content, tmp_path: Path, start: float, end: float, said: str
) -> None:
    """The result of the sample does not state the end of the run."""
    rewritten = clipped(content, start, end).write(tmp_path / "log.mcap")
    with RunLog(log_path) as one, RunLog(rewritten) as other:
        assert other.recovered == (f"{rewritten}: {said}" if said else "")
        assert list(other.ticks()) == list(one.ticks(start, end))
        assert other.tree() == one.tree()  # the metadata have it, too


def test_a_hole_is_a_gap(content: Content, tmp_path: Path) -> None:
    holed = content.ordered(sent for sent in content.messages if not SECOND < sent.time < 2 * SECOND)
    with RunLog(holed.write(tmp_path / "log.mcap")) as log:
        assert log.recovered == f"{log.path}: 1.00 s to 2.00 s are missing"
        (gap,) = log.gaps
        assert [gap.contains(t) for t in (0.95, 1.0, 1.5, 2.0, 2.05)] == [False, True, True, True, False]


@pytest.mark.parametrize(("status", "said"), [("RUNNING", True), ("SUCCESS", False)])
def test_behind_the_last_tick_of_a_run_nothing_is_missing(
    content: Content, tmp_path: Path, status: str, said: bool
) -> None:
    """The arm comes to rest a few ticks after the tree has ended."""
    result = next(each for each in content.metadata if each.name == "picktree.result")
    last = content.messages[-1].time / SECOND
    stated = Metadata(result.name, {**result.metadata, "json": f'{{"sim_seconds": {last + 0.15}}}'})
    changed = replace(
        content.each(lambda sent: replace(sent, data=with_root_status(sent, status))),
        metadata=[*(each for each in content.metadata if each is not result), stated],
    )
    with RunLog(changed.write(tmp_path / "log.mcap")) as log:
        text = f"{log.path}: the log ends at {last:.2f} s, before its run: everything after is missing"
        assert log.recovered == (text if said else "")


def with_root_status(sent: Sent, status: str) -> bytes:
    return re.sub(rb'"root_status":"[A-Z]+"', f'"root_status":"{status}"'.encode(), sent.data)


def test_without_metadata_the_run_is_read_and_its_settings_are_unknown(
    log_path: Path, content: Content, tmp_path: Path
) -> None:
    content = replace(content, metadata=[])
    with RunLog(log_path) as one, RunLog(content.write(tmp_path / "log.mcap")) as other:
        assert list(other.ticks()) == list(one.ticks())
        assert (other.run.seed, other.run.seed_text, other.run.tick) == (None, "seed unknown", 0.05)
        assert other.format == FORMAT
        assert other.lacks_result
        assert other.recovered == (
            f"{other.path}: it lacks its metadata: settings and result of the run are unknown"
        )


def test_a_log_of_two_runs_is_named_as_that(content: Content, tmp_path: Path) -> None:
    record = next(each for each in content.metadata if each.name == "picktree")
    other = replace(record, metadata={**record.metadata, "seed": "8"})
    merged = replace(content, metadata=[*content.metadata, other]).write(tmp_path / "log.mcap")
    with pytest.raises(PicktreeError) as raised:
        RunLog(merged)
    assert str(raised.value) == (
        f"{merged}: a file of more than one run: its metadata picktree state for seed both '7' and '8'; "
        "give the log of one run"
    )


def test_metadata_of_another_program_may_change(content: Content, tmp_path: Path) -> None:
    """A bag of ROS 2 states its length at its start and at its end."""
    first, last = (Metadata("rosbag2", {"duration": text}) for text in ("0", "2.95"))
    with RunLog(
        replace(content, metadata=[first, *content.metadata, last]).write(tmp_path / "a.mcap")
    ) as log:
        assert log.metadata["rosbag2"] == {"duration": "2.95"}


def of_another_program(content: Content) -> Content:
    return Content([Sent("/rosout", "cdr", None, 5, b"", 1, 5)], [], [], profile="ros2")


def without_messages(content: Content) -> Content:
    return Content([], [], [])


def joints_only(content: Content) -> Content:
    return content.ordered(sent for sent in content.messages if sent.topic == "/joint_states")


def renamed(content: Content) -> Content:
    return content.each(lambda sent: replace(sent, topic=f"/cell{sent.topic}"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            of_another_program,
            "an MCAP file, but not a log of picktree, written by other tool ros2: it has /rosout; "
            "`picktree run MISSION` records one",
        ),
        (
            without_messages,
            "an MCAP file, but not a log of picktree, written by other tool: it has no messages; "
            "`picktree run MISSION` records one",
        ),
        (
            joints_only,
            "a log without ticks, written by other tool: it has /joint_states; keep /bt/tick when a log is "
            "filtered",
        ),
        (
            renamed,
            "a log without ticks, written by other tool: it has /cell/bt/tree, /cell/scene/robot, "
            "/cell/camera/overhead/calibration, /cell/camera/overhead/colour and 14 more; keep /bt/tick when "
            "a log is filtered",
        ),
    ],
)
def test_another_file_is_named_as_what_it_is(
    content: Content, tmp_path: Path, change: Callable[[Content], Content], said: str
) -> None:
    path = change(content).write(tmp_path / "other.mcap")
    with pytest.raises(PicktreeError) as raised:
        RunLog(path)
    assert str(raised.value) == f"{path}: {said}"


def test_a_log_that_another_recorder_left_unfinished_is_salvaged(
    log_path: Path, content: Content, tmp_path: Path
) -> None:
    for form in ("lz4", "plain", "unchunked"):
        written = WRITING[form](content).with_options(chunk_size=10_000)
        data = written.write(tmp_path / "whole.mcap").read_bytes()
        cut = tmp_path / f"{form}.mcap"
        cut.write_bytes(data[: len(data) // 2])
        with RunLog(log_path) as one, RunLog(cut) as log:
            assert "the file was not finished; recovered up to byte" in log.recovered
            ticks = list(log.ticks())
            assert ticks
            assert ticks == list(one.ticks(end=log.end))[: len(ticks)]


@pytest.fixture(scope="module")
def rotated(sample: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a log in three files."""
    folder = tmp_path_factory.mktemp("rotated")
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    with Recorder(folder / "log.mcap", sample.RUN, rotation=Rotation(seconds=1.1)) as recorder:
        sample.start(recorder)
        for k in range(60):
            recorder.rotate_if_due(k * 0.05)
            sample.step(recorder, scene, k)
        recorder.finish({"status": "SUCCESS"})
    return folder


@pytest.mark.parametrize("kept", [True, False])
def test_each_file_of_a_rotated_log_may_be_rewritten(rotated: Path, tmp_path: Path, kept: bool) -> None:
    for path in rotated.iterdir():
        content = WRITING["lz4"](ORDER["epoch"](Content.of(path)))
        replace(content, metadata=content.metadata if kept else []).write(tmp_path / path.name)
    with RunLog(rotated) as one, RunLog(tmp_path) as other:
        assert len(other.paths) == len(one.paths) == 3
        assert told(other) == told(one)
        assert other.gaps == ()


def test_a_damaged_second_leaves_out_that_second(log_path: Path, tmp_path: Path) -> None:
    data = bytearray(log_path.read_bytes())
    with log_path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[-2]
    data[chunk.chunk_start_offset + chunk.chunk_length - 50] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    with Run(log_path) as one, Run(damaged) as other:
        assert "damaged at byte" in other.recovered
        (gap,) = other.log.gaps
        found = diff(one, other)
        assert (found.verdict, found.left_out) == ("identical", (f"B: {gap.text()}",))
        assert first_difference(one, other) is None
        assert found.alignment.until == gap.start
        assert found.alignment.parting is None


def test_dropped_topics_are_left_out_of_a_comparison_and_named(
    log_path: Path, content: Content, tmp_path: Path
) -> None:
    dropped = content.ordered(sent for sent in content.messages if not sent.topic.startswith("/camera"))
    with Run(log_path) as one, Run(dropped.write(tmp_path / "log.mcap")) as other:
        found = diff(one, other)
        assert found.verdict == "identical"
        assert found.left_out == (
            "B: it lacks the topics /camera/overhead/calibration, /camera/overhead/colour and "
            "/camera/overhead/depth",
        )


def test_a_message_that_differs_is_found_whatever_digest_the_log_states(
    log_path: Path, content: Content, tmp_path: Path
) -> None:
    content = ORDER["shuffled"](content)
    changed = content.each(
        lambda sent: (
            replace(sent, data=sent.data.replace(b'"controller":"Track"', b'"controller":"Other"'))
            if (sent.topic, sent.time) == ("/control", SECOND)
            else sent
        )
    )
    with Run(log_path) as one, Run(changed.write(tmp_path / "log.mcap")) as other:
        found = first_difference(one, other)
        assert found is not None
        assert (found.topic, found.time, found.field) == ("/control", 1.0, "controller")
        assert other.log.result["digest"] == one.log.result["digest"]

"""Logs in several files: each opens by itself, and together they are the log that one file would be."""

import json
import os
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader

from picktree.analysis import Run
from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.log_files import Rotation, find_log
from picktree.logs.mcap import writer
from picktree.logs.recording import Recorder
from picktree.world import BlackboardWrite, PlanningScene, Tick, Transition

TICKS = 100
RUNNING = Transition("/Main", "RUNNING", {"to": "home"}, "red_block_1")
GRASPING = Transition(
    "/Main/Grasp", "RUNNING", {"object": "red_block_1"}, "red_block_1", message="approaching"
)
SNAPSHOTS = "/bt/nodes"
"""Topic whose messages repeat what the ticks say, once in each chunk of a file."""
GRASPED = Transition("/Main/Grasp", "SUCCESS", message="held")


def eventful(sample: ModuleType, k: int) -> Tick:
    """The root runs all the time, the skill over each half second."""
    main, grasp = sample.tick(1).nodes
    nodes = (main, grasp if k % 10 < 5 else replace(grasp, status="SUCCESS", message="held"))
    return Tick(
        "RUNNING",
        "/Main/Grasp",
        nodes,
        (
            BlackboardWrite("/n", k, "/Main"),
            *((BlackboardWrite("/item", "red_block_1", "/Main"),) if k == 0 else ()),
        ),
        (
            *((RUNNING,) if k == 0 else ()),
            *((GRASPED,) if k % 10 == 5 else (GRASPING,) if k % 10 == 0 else ()),
        ),
    )


def record(
    sample: ModuleType,
    path: Path,
    rotation: Rotation,
    ticks: int = TICKS,
    instead: Callable[[ModuleType, int], Tick | None] = eventful,
) -> None:
    """Five seconds."""
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    with Recorder(path, sample.RUN, rotation=rotation) as recorder:
        sample.start(recorder)
        for k in range(ticks):
            recorder.rotate_if_due(k * 0.05)
            if k in (5, 60):
                recorder.attach(f"checkpoint-{k}.json", f"{k}", slot="checkpoint")
            sample.step(recorder, scene, k, instead=instead(sample, k))
        recorder.finish({"status": "SUCCESS"})


@pytest.fixture(scope="module")
def whole(sample: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "log.mcap"
    record(sample, path, Rotation())
    return path


@pytest.fixture(scope="module")
def rotated(sample: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a log in four files; do not change them."""
    folder = tmp_path_factory.mktemp("rotated")
    record(sample, folder / "log.mcap", Rotation(seconds=1.4))
    return folder


@pytest.fixture
def copied(rotated: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(rotated, tmp_path / "copy"))


def test_together_they_are_the_log_in_one_file(whole: Path, rotated: Path) -> None:
    with RunLog(whole) as one, RunLog(rotated) as many:
        assert many.recovered == ""
        assert many.path == rotated / "log.mcap"
        assert [path.name for path in many.paths] == [
            "log.mcap", "log-0002.mcap", "log-0003.mcap", "log-0004.mcap",
        ]  # fmt: skip
        told, expected = (
            [message for message in log.messages() if message.topic != SNAPSHOTS] for log in (many, one)
        )
        assert told == expected
        assert {name: info for name, info in many.topics.items() if name != SNAPSHOTS} == {
            name: info for name, info in one.topics.items() if name != SNAPSHOTS
        }
        assert (
            many.attachments == one.attachments == ("mission.yaml", "checkpoint-5.json", "checkpoint-60.json")
        )
        assert many.attachment("checkpoint-60.json") == b"60"
        assert many.metadata == one.metadata
        assert many.digest() == one.digest() == many.result["digest"]
        assert (many.run, many.end, many.part) == (one.run, one.end, 1)
        for at in (0.0, 1.38, 1.4, 1.45, 3.3, 9.0):
            assert many.belief_at(at) == one.belief_at(at)
            assert many.tick_at(at) == one.tick_at(at)
        assert list(many.ticks(1.2, 3.4)) == list(one.ticks(1.2, 3.4))
    with Run(whole) as one, Run(rotated) as many:
        assert many.visits == one.visits
        assert many.ticks.times == one.ticks.times


@pytest.mark.parametrize("number", [2, 3, 4])
def test_each_file_opens_by_itself_with_all_that_it_needs(whole: Path, rotated: Path, number: int) -> None:
    path = rotated / f"log-{number:04d}.mcap"
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        counts = Counter(channel.topic for _, channel, _ in reader.iter_messages())
        statistics = reader.get_summary()
    assert statistics is not None
    with RunLog(whole) as one, RunLog(path) as part:
        assert (part.part, part.paths, part.recovered) == (number, (path,), "")
        assert number < 4 or part.digest() == part.result["digest"]
        assert part.run == one.run
        assert part.tree() == one.tree()
        assert part.robot_model() == one.robot_model()
        assert set(part.topics) >= {"/scene/robot", "/truth/objects", "/events"}
        assert counts == {name: info.messages for name, info in part.topics.items() if info.messages}
        checkpoints = {2: [5], 3: [5, 60], 4: [60]}[number]
        assert part.attachments == ("mission.yaml", *(f"checkpoint-{k}.json" for k in checkpoints))
        start = next(part.messages()).time / 1e9
        for read in (RunLog.belief_at, RunLog.truth_at):
            here, there = read(part, start), read(one, start)
            assert here is not None and there is not None
            assert (here.record, here.time) == (there.record, pytest.approx(start))
        assert {message.topic for message in part.messages(end=start)} >= {
            "/bt/tree", "/bt/tick", "/joint_states", "/tf", "/wrench", "/scene/robot", "/scene/objects",
        }  # fmt: skip
        assert {message.time for message in part.messages(end=start)} == {round(start * 1e9)}
        for message in part.messages(["/scene/robot", "/scene/objects", "/truth/objects"], end=start):
            update = SceneUpdate.FromString(message.data)
            stamps = {e.timestamp.ToNanoseconds() for e in (*update.entities, *update.deletions)}
            assert stamps == {message.time}
        told, expected = (
            [message for message in log.messages(None, start + 0.01, part.end) if message.topic != SNAPSHOTS]
            for log in (part, one)
        )
        assert told == expected


def test_a_file_by_itself_knows_what_was_running_and_written(whole: Path, rotated: Path) -> None:
    with Run(whole) as one, Run(rotated / "log-0003.mcap") as part:
        number = one.ticks.number_at(part.ticks.times[0])
        first, same = part.ticks[0].record, one.ticks[number].record
        assert (first.nodes, first.tip) == (same.nodes, same.tip)
        assert part.blackboard_at(part.ticks.times[0]) == one.blackboard_at(part.ticks.times[0])
        running = [t for t in (RUNNING, GRASPING) if t is RUNNING or number % 10 < 5]
        assert list(first.transitions) == running
        since = [v for v in one.visits if v.end >= part.ticks.times[0] and v.start <= part.end]
        assert [(v.path, v.item, v.inputs) for v in part.visits] == [
            (v.path, v.item, v.inputs) for v in since if v.outcome == "RUNNING" or v.end > part.ticks.times[0]
        ]


def test_what_needs_the_beginning_of_a_run_is_told_that_it_is_not_there(rotated: Path) -> None:
    path = rotated / "log-0002.mcap"
    with RunLog(rotated) as log, RunLog(path) as part:
        log.require_beginning()
        with pytest.raises(PicktreeError) as raised:
            part.require_beginning()
    assert str(raised.value) == (
        f"{path}: part 2 of a log in several files, which begins in the middle of the run; give the run's "
        "folder"
    )


def remove_second(folder: Path) -> None:
    (folder / "log-0002.mcap").unlink()


def remove_end(folder: Path) -> None:
    for number in (3, 4):
        (folder / f"log-000{number}.mcap").unlink()


def damage_third(folder: Path) -> None:
    (folder / "log-0003.mcap").write_bytes(b"rubbish")


@pytest.mark.parametrize(
    ("change", "said", "lost"),
    [
        (remove_second, "log-0002.mcap is missing: 1.35 s to 2.75 s lost", (1.38, 2.78)),
        (remove_end, "log-0003.mcap is missing: everything after 2.75 s lost", (2.78, 9.0)),
        (
            damage_third,
            "log-0003.mcap: not a log: a text file; it does not begin as an MCAP file does; give a run's "
            "folder, or its log.mcap: 2.75 s to 4.15 s lost",
            (2.78, 4.18),
        ),
    ],
)
def test_a_file_that_is_missing_or_damaged_costs_only_itself(
    copied: Path, whole: Path, change: Callable[[Path], None], said: str, lost: tuple[float, float]
) -> None:
    change(copied)
    with RunLog(copied) as log, RunLog(whole) as one:
        assert log.recovered == f"{copied}/{said}"
        assert list(log.ticks()) == [at for at in one.ticks() if not lost[0] < at.time < lost[1]]
        assert log.result == ({} if change is remove_end else one.result)


def test_a_file_of_another_run_is_left_out(copied: Path, sample: ModuleType, tmp_path: Path) -> None:
    other = tmp_path / "other"
    record(sample, other / "log.mcap", Rotation(seconds=1.4), instead=lambda sample, k: None)
    shutil.copy(other / "log-0002.mcap", copied)
    with RunLog(copied) as log:
        assert log.recovered == f"{copied / 'log-0002.mcap'} belongs to another log: 1.35 s to 2.75 s lost"


def test_without_its_first_file_a_log_says_what_is_there(copied: Path) -> None:
    (copied / "log.mcap").unlink()
    with pytest.raises(PicktreeError) as raised:
        find_log(copied)
    assert str(raised.value) == (
        f"{copied}: there is no log.mcap in this folder; it holds log-0002.mcap, log-0003.mcap, "
        "log-0004.mcap, which open by their own names"
    )


def test_the_last_run_is_the_one_written_last_whatever_its_number_of_files(
    rotated: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    long = Path(shutil.copytree(rotated, tmp_path / "runs" / "long"))
    short = tmp_path / "runs" / "short"
    short.mkdir()
    shutil.copy(whole, short / "log.mcap")
    for path, written in (
        (long / "log.mcap", 100), (long / "log-0002.mcap", 200), (long / "log-0003.mcap", 300),
        (long / "log-0004.mcap", 400), (short / "log.mcap", 350),
    ):  # fmt: skip
        os.utime(path, (written, written))
    assert find_log("last").absolute() == long / "log.mcap"
    os.utime(short / "log.mcap", (500, 500))
    assert find_log("last").absolute() == short / "log.mcap"


def test_files_are_as_large_as_asked_for(sample: ModuleType, tmp_path: Path) -> None:
    record(sample, tmp_path / "log.mcap", Rotation(size=80_000), 4 * TICKS)
    sizes = [path.stat().st_size for path in sorted(tmp_path.iterdir())]
    assert len(sizes) > 1
    assert all(size < 90_000 for size in sizes)
    with RunLog(tmp_path) as log:
        assert log.recovered == ""


def test_a_limit_that_a_file_cannot_keep_is_refused(sample: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(PicktreeError) as raised:
        record(sample, tmp_path / "log.mcap", Rotation(size=10_000))
    assert str(raised.value).startswith(f"{tmp_path / 'log.mcap'}: each part of this log begins with 0.0")
    assert str(raised.value).endswith(" MB that it needs to open by itself; rotate it at 1 MB or more")


def test_a_disk_that_is_full_at_a_rotation_leaves_the_files_before(
    sample: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real: Callable[[Path], writer.RawFile] = writer.open_raw

    def second_refused(path: Path) -> writer.RawFile:
        if "0002" in path.name:
            raise OSError(28, "No space left on device")
        return real(path)

    monkeypatch.setattr(writer, "open_raw", second_refused)
    with pytest.raises(
        PicktreeError, match=r"log-0002.mcap: the log cannot be written: No space left on device"
    ):
        record(sample, tmp_path / "log.mcap", Rotation(seconds=1.4))
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]
    with RunLog(tmp_path) as log:
        assert log.recovered == ""
        assert log.result["ended"] == "PicktreeError"
        assert log.end == 1.35


def test_what_a_file_says_of_itself_is_in_its_metadata(rotated: Path) -> None:
    with RunLog(rotated / "log-0002.mcap") as part, RunLog(rotated / "log-0003.mcap") as after:
        words = part.metadata["picktree.part"]
        assert (words["number"], words["start"]) == ("2", "1350000000")
        assert json.loads(words["repeated"])["/bt/tick"] == 1
        assert part.metadata["picktree.next"] == {
            "part": "log-0003.mcap", "digest": after.metadata["picktree.part"]["digest"]
        }  # fmt: skip

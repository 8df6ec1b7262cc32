"""A run is made again from a log that another tool has rewritten, and compared with what that log has."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.analysis import RunChanges
from picktree.analysis.resim import ResimAnswer, ResimOrder, run_order
from picktree.files import PicktreeError
from picktree.logs import RunLog, RunResult
from picktree.session import RunRequest, Session

from ..logs.rewriting import ORDER, SECOND, WRITING, Content, Sent, jittered

MISSION = """\
picktree: 1
kind: mission
scene: sort_small
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - Grasp: {object: red_block_1}
      - Log: {message: hello}
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "mission.yaml").write_text(MISSION)
    return Session(RunRequest(folder / "mission.yaml", seed=3, out=folder, backend="kinematic")).run()


def again(recorded: RunResult, path: Path, change: Callable[[Content], Content]) -> ResimAnswer:
    log = change(Content.of(recorded.log)).write(path / "log.mcap")
    return run_order(ResimOrder(log, RunChanges(), None, None), lambda _: None)


def without_middle(content: Content) -> Content:
    return content.ordered(sent for sent in content.messages if not SECOND // 4 < sent.time < SECOND // 2)


def without_head(content: Content) -> Content:
    return content.ordered(sent for sent in content.messages if sent.time > SECOND // 4)


def without_tail(content: Content) -> Content:
    return content.ordered(sent for sent in content.messages if sent.time <= SECOND // 2)


def without_camera(content: Content) -> Content:
    return content.ordered(sent for sent in content.messages if not sent.topic.startswith("/camera"))


def without_tree(content: Content) -> Content:
    return content.ordered(sent for sent in content.messages if sent.topic != "/bt/tree")


def other_wrench(content: Content) -> Content:
    def change(sent: Sent) -> Sent:
        if (sent.topic, sent.time) != ("/wrench", SECOND // 2):
            return sent
        return replace(sent, data=sent.data.replace(b'"x":', b'"x":1', 1))

    return ORDER["shuffled"](content.each(change))


@pytest.mark.parametrize("mode", ["lz4", "unchunked", "reversed", "twice", "epoch"])
def test_a_rewritten_log_is_run_again_byte_for_byte(recorded: RunResult, tmp_path: Path, mode: str) -> None:
    answer = again(recorded, tmp_path, {**WRITING, **ORDER}[mode])
    assert (answer.difference, answer.trees, answer.exact) == (None, None, True)
    assert answer.digest == recorded.digest


@pytest.mark.parametrize("change", [without_middle, without_head, without_tail, without_camera, without_tree])
def test_what_the_log_lacks_is_not_compared(
    recorded: RunResult, tmp_path: Path, change: Callable[[Content], Content]
) -> None:
    answer = again(recorded, tmp_path, change)
    assert answer.difference is None
    assert answer.trees is None
    assert not answer.exact  # no digest of a part is told as that of the run
    with RunLog(recorded.log) as log:
        assert 5 < answer.ticks <= len(list(log.ticks()))


def test_late_messages_take_the_times_of_their_ticks(recorded: RunResult, tmp_path: Path) -> None:
    """Events and plans have no stamps: they take their times from what is written around them."""
    late = jittered(Content.of(recorded.log), 40_000_000).write(tmp_path / "log.mcap")
    with RunLog(recorded.log) as one, RunLog(late) as other:
        for topic in one.topics:
            assert list(other.messages([topic])) == list(one.messages([topic])), topic


def test_a_changed_message_is_found(recorded: RunResult, tmp_path: Path) -> None:
    answer = again(recorded, tmp_path, other_wrench)
    assert answer.difference is not None
    assert (answer.difference.topic, answer.difference.field) == ("/wrench", "force.x")
    assert answer.difference.time == pytest.approx(0.5)


def test_a_missing_message_is_found(recorded: RunResult, tmp_path: Path) -> None:
    def change(content: Content) -> Content:
        return content.ordered(
            sent for sent in content.messages if (sent.topic, sent.time) != ("/wrench", SECOND // 2)
        )

    answer = again(recorded, tmp_path, change)
    assert answer.difference is not None
    assert (answer.difference.topic, answer.difference.missing) == ("/wrench", "a")


def without_metadata(content: Content) -> Content:
    return replace(content, metadata=[])


def without_files(content: Content) -> Content:
    return replace(content, attachments=[])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without_metadata, "the log lacks its metadata, and with them the seed, so it cannot be run again; "),
        (without_files, "no file 'mission.yaml' in the log; it holds: none; "),
    ],
)
def test_a_log_without_settings_or_files_is_refused(
    recorded: RunResult, tmp_path: Path, change: Callable[[Content], Content], said: str
) -> None:
    with pytest.raises(PicktreeError) as raised:
        again(recorded, tmp_path, change)
    assert str(raised.value).startswith(f"{tmp_path / 'log.mcap'}: {said}keep the ")

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


def during(start: float, end: float) -> Callable[[Sent], bool]:
    return lambda sent: start < sent.time / SECOND < end


def of(topic: str) -> Callable[[Sent], bool]:
    return lambda sent: sent.topic.startswith(topic)


def without(dropped: Callable[[Sent], bool]) -> Callable[[Content], Content]:
    return lambda content: content.ordered(sent for sent in content.messages if not dropped(sent))


def other_wrench(content: Content) -> Content:
    def change(sent: Sent) -> Sent:
        if (sent.topic, sent.time) != ("/wrench", SECOND // 2):
            return sent
        return replace(sent, data=sent.data.replace(b'"x":', b'"x":1', 1))

    return ORDER["shuffled"](content.each(change))


def test_a_rewritten_log_is_run_again_byte_for_byte(recorded: RunResult, tmp_path: Path) -> None:
    """`test_rewritten_logs.py` reads all forms."""
    answer = again(recorded, tmp_path, lambda content: WRITING["lz4"](ORDER["epoch"](content)))
    assert (answer.difference, answer.trees, answer.exact) == (None, None, True)
    assert answer.digest == recorded.digest


@pytest.mark.parametrize(
    "dropped",
    [during(0.25, 0.5), during(-1.0, 0.251), during(0.501, 1e9), of("/camera"), of("/bt/tree")],
    ids=["middle", "head", "tail", "camera", "tree"],
)
def test_what_the_log_lacks_is_not_compared(
    recorded: RunResult, tmp_path: Path, dropped: Callable[[Sent], bool]
) -> None:
    answer = again(recorded, tmp_path, without(dropped))
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
    lost = without(lambda sent: (sent.topic, sent.time) == ("/wrench", SECOND // 2))
    answer = again(recorded, tmp_path, lost)
    assert answer.difference is not None
    assert (answer.difference.topic, answer.difference.missing) == ("/wrench", "a")


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ("metadata", "the log lacks its metadata, and with them the seed, so it cannot be run again; "),
        ("attachments", "no file 'mission.yaml' in the log; it holds: none; "),
    ],
)
def test_a_log_without_settings_or_files_is_refused(
    recorded: RunResult, tmp_path: Path, part: str, said: str
) -> None:
    with pytest.raises(PicktreeError) as raised:
        again(recorded, tmp_path, lambda content: replace(content, **{part: []}))
    assert str(raised.value).startswith(f"{tmp_path / 'log.mcap'}: {said}keep the ")

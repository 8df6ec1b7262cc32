"""A run with a feed: its events, counts and truth; taken up from a checkpoint, run again, explained."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from picktree.analysis import Run, RunChanges
from picktree.analysis.resim import ResimOrder, run_order
from picktree.logs import RunResult
from picktree.session import Observer, RecordedRun, RunRequest, Session, simulated_messages
from picktree.session.checkpoints import RunState
from picktree.session.run_recipe import Recording
from picktree.world import Tick
from picktree.world.world_facts import FeedProgressState

SCENE = """\
picktree: 1
kind: scene
base: three_bins
checkpoint_every: 1
spawn: []
feed:
  - of: {block: 1, plate: 1}
    colours: [red, green]
    area: {min: [0.40, -0.20], max: [0.60, 0.20]}
    gap: 80 mm
    total: 4
exchange: {takes: 1 s}
"""
MISSION = """\
picktree: 1
kind: mission
scene: cell.yaml
include: [library/feeding]
trees:
  Main:
    Repeat:
      while: items_left or not feed_exhausted
      do:
        Sequence:
          - EmptyFullBins: {bins: [red_bin, green_bin], fill: 0.02}
          - AwaitMore: {_skipIf: items_left}
          - Observe: {objects: "{seen}"}
          - ForEach: {in: "{seen}", out: "{item}", do: {PickAndPlaceOrSetAside: {item: "{item}"}}}
          - StandBy
"""


class Progress(Observer):
    """Counts of done and all items that an observer gets at each tick."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int]] = []

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        if (items_done, items_total) not in self.seen:
            self.seen.append((items_done, items_total))


def write(folder: Path, scene: str = SCENE) -> Path:
    (folder / "cell.yaml").write_text(scene)
    (folder / "on.yaml").write_text(MISSION)
    return folder / "on.yaml"


def session(mission: Path, watcher: Progress | None = None) -> Session:
    return Session(
        RunRequest(mission, seed=2, backend="kinematic", out=mission.parent / "runs"),
        observers=[watcher] if watcher else [],
    )


COUNTS = [(0, 0), (0, 2), (1, 2), (2, 2), (2, 4), (3, 4), (4, 4)]
"""Items done, and those that have come so far."""


@pytest.fixture(scope="module")
def progress() -> Progress:
    return Progress()


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, progress: Progress) -> RunResult:
    return session(write(tmp_path_factory.mktemp("fed")), progress).run()


@pytest.fixture(scope="module")
def recorded(result: RunResult) -> Iterator[RecordedRun]:
    with Run(result.log) as run, RecordedRun(run) as found:
        yield found


def test_it_goes_on_until_the_feed_is_exhausted(result: RunResult, progress: Progress) -> None:
    assert (result.status, result.items.total, result.items.sorted) == ("success", 4, 4)
    assert result.feed is not None
    assert result.feed.deliveries == 2
    assert result.feed.exchanges > 0
    assert (result.picks.objects, result.picks.held_first_try) == (4, 4)
    assert progress.seen == COUNTS


def test_also_of_a_feed_without_an_end_the_total_is_what_has_come(tmp_path: Path) -> None:
    progress = Progress()
    mission = write(tmp_path, SCENE.replace("    total: 4\n", ""))
    mission.write_text(MISSION.replace("not feed_exhausted", "items_done < 3"))
    result = session(mission, progress).run()
    assert progress.seen == COUNTS
    assert (result.status, result.items.total) == ("success", 4)


def test_what_came_and_went_is_in_the_log_at_once(result: RunResult) -> None:
    with Run(result.log) as run:
        moments = {at.time: {str(b.id) for b in at.record.bodies} for at in run.log.truths()}
        events = [at for at in run.events if at.record.kind in ("delivery", "bin_exchanged")]
        there: set[str] = set()
        for event in events:
            seen = moments[event.time]
            if event.record.kind == "delivery":
                assert len(seen - there) == event.record.data["items"] == 2
            else:
                after = next(bodies for time, bodies in moments.items() if time > event.time)
                assert len(seen - after) == event.record.data["items"]
            there = seen
        kinds = [at.record.kind for at in events]
        assert kinds.count("delivery") == 2
        emptied = [at.record for at in run.events if at.record.kind == "bin_emptied"]
        assert len(emptied) == kinds.count("bin_exchanged") > 0
        gone = [name for record in emptied for name in record.data["objects"]]  # type: ignore[attr-defined]
        changes = [at.record.data for at in run.events if at.record.kind == "belief"]
        assert [c["object"] for c in changes if c["after"] is None] == gone
        assert {c["reason"] for c in changes if c["after"] is None} == {"taken away with its bin"}


def test_it_is_explained_without_anything_vanishing(result: RunResult) -> None:
    with Run(result.log) as run:
        story = run.explanation
    assert story.outcome.sentence == (
        "the mission succeeded and its goal is reached: 4 of 4 items are where they belong"
    )
    assert (story.root_causes, story.failures) == ((), ())
    assert [item.state for item in story.items] == ["done"] * 4
    gone = [item for item in story.items if "taken away with it" in item.truth]
    assert gone
    for item in gone:
        assert item.truth == f"truly in {item.colour}_bin, where it belongs, and was taken away with it"
        assert item.events[-1].what == "taken away with its bin"


def test_memory_of_what_is_gone_is_not_kept(recorded: RecordedRun) -> None:
    state = recorded.state(recorded.checkpoints()[-1])
    assert state.tally is not None
    assert state.tally.gone > 0
    assert set(state.tally.objects) <= {str(o.id) for o in state.belief.scene.objects}
    assert state.tally.gone + len(state.tally.objects) == state.items_done
    assert state.noticed.deliveries == state.tally.deliveries == 2
    assert sum(state.noticed.exchanges.values()) == state.tally.exchanges > 0


def test_from_each_checkpoint_it_goes_on_byte_for_byte(recorded: RecordedRun, tmp_path: Path) -> None:
    names = recorded.checkpoints()
    assert len(names) >= 3
    for name in (names[1],):
        recipe = recorded.from_checkpoint(name, recorded.state(name))
        again = Session(recipe, record=Recording(tmp_path)).run()
        with Run(again.log) as other:
            assert other.info.continues is not None
            time = other.info.continues.time
            went_on = [(m.topic, m.time, m.data) for m in simulated_messages(other.log)]
            before = [(m.topic, m.time, m.data) for m in simulated_messages(recorded.run.log, time)]
            assert went_on == before
        assert recorded.run.result is not None
        assert (again.digest, again.feed, again.picks) == (
            recorded.run.result.digest,
            recorded.run.result.feed,
            recorded.run.result.picks,
        )


def test_run_again_from_its_log_it_is_the_same(result: RunResult) -> None:
    again = run_order(ResimOrder(result.log, RunChanges(), 12.0, None), lambda _: None)
    assert (again.exact, again.difference) == (True, None)
    assert again.ticks > 200


def test_what_cannot_be_had_is_set_aside_and_the_feed_goes_on(tmp_path: Path) -> None:
    slab = "catalogue:\n  slab: {box: [110 mm, 100 mm, 40 mm], mass: 300 g, friction: 0.6}\n"
    scene = SCENE.replace("plate: 1", "slab: 1").replace("total: 4", "total: 2") + slab
    result = session(write(tmp_path, scene)).run()
    assert (result.status, result.items.sorted, result.items.left) == ("incomplete", 1, 1)
    assert result.feed is not None
    assert (result.feed.deliveries, result.feed.set_aside) == (1, 1)
    with Run(result.log) as run:
        slabs = [item for item in run.items if item.kind == "slab"]
    assert [item.state for item in slabs] == ["aside"]
    assert [item.events[-1].what for item in slabs] == ["set aside: left where it lies"]


def test_a_checkpoint_from_before_there_were_feeds_is_read(recorded: RecordedRun) -> None:
    state = recorded.state(recorded.checkpoints()[0])
    plain = json.loads(state.to_json())
    del plain["noticed"]
    for name in ("gone", "gone_first_try", "deliveries", "exchanges", "set_aside"):
        del plain["tally"][name]
    older = RunState.from_json(json.dumps(plain).encode())
    assert older.noticed == FeedProgressState()
    assert older.tally is not None
    assert (older.tally.done, older.tally.gone, older.tally.deliveries) == (state.items_done, 0, 0)

"""A run that empties a tote goes on from its checkpoints as it was: with the heap that it saw."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.explain import scene_of
from picktree.logs import RunResult
from picktree.session import RecordedRun, RunRequest, Session, simulated_messages
from picktree.session.run_recipe import Recording
from picktree.simulation.heap_spawning import mesh_files
from picktree.world.event_types import BinEmptiedEvent, ItemDoneEvent

SCENE = """\
picktree: 1
kind: scene
base: tote
checkpoint_every: 1
cameras: {overhead: {size: [320, 240]}}
spawn: [{of: {assortment: 3}, colours: [red, blue], into: tote, drop: heap}]
"""
SEED = 9
EXAMPLES = Path(__file__).parents[2] / "examples"
MISSION = """\
picktree: 1
kind: mission
name: two
scene: few.yaml
goal: sorted >= 2
trees:
  Main:
    Repeat:
      num_cycles: 2
      do:
        Sequence:
          - PickAny: {from: tote, out: "{thing}"}
          - Place: {object: "{thing}", into: "{thing.destination}"}
"""


@pytest.fixture(scope="module")
def emptied(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("tote")
    (folder / "few.yaml").write_text(SCENE)
    (folder / "two.yaml").write_text(MISSION)
    return Session(RunRequest(folder / "two.yaml", seed=SEED, out=folder)).run()


@pytest.fixture
def recorded(emptied: RunResult) -> Iterator[RecordedRun]:
    with Run(emptied.log) as run, RecordedRun(run) as found:
        yield found


PILE = """\
picktree: 1
kind: scene
base: pile
cameras: {overhead: {size: [320, 240]}}
assortment: {meshes: things, scale: 0.0092, density: 1500, friction: 0.5, least_mass: 30 g}
spawn:
  - of: {assortment: 2}
    colours: [red, blue]
    area: {min: [0.40, -0.10], max: [0.60, 0.10]}
    drop: pile
destinations:
  - {where: "mass > 0.055 and size > 0.07", to: red_bin}
  - {where: "mass <= 0.055", to: blue_bin}
"""


@pytest.fixture(scope="module")
def cleared(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A run with the meshes of a folder, which is gone afterwards."""
    folder = tmp_path_factory.mktemp("pile")
    (folder / "things").mkdir()
    for file in mesh_files("random_urdfs")[2:6]:
        shutil.copy(file, folder / "things")
    (folder / "few.yaml").write_text(PILE)
    (folder / "two.yaml").write_text(MISSION.replace("from: tote", "from: table"))
    result = Session(RunRequest(folder / "two.yaml", seed=SEED, out=folder)).run()
    shutil.rmtree(folder / "things")
    return result


def test_a_pile_on_the_table_is_one_object_from_which_things_are_taken(cleared: RunResult) -> None:
    assert (cleared.status, cleared.items.sorted, cleared.items.misplaced) == ("success", 2, 0)
    with Run(cleared.log) as run:
        done = {at.record.into for at in run.events if isinstance(at.record, ItemDoneEvent)}
        assert done == {"red_bin", "blue_bin"}, "they are sorted by what they weigh, and by their size"
        times = np.arange(0.5, cleared.sim_seconds, 0.5)
        beliefs = [found.record for at in times if (found := run.log.belief_at(at)) is not None]
    seen = {body.id: (body.role, body.place) for belief in beliefs for body in belief.bodies}
    assert seen.pop("table_heap") == ("heap", "table")
    assert {role for role, _ in seen.values()} == {"item"}, "what lies in the pile is nothing else besides"


def test_the_log_holds_the_meshes_of_a_folder(cleared: RunResult, tmp_path: Path) -> None:
    with Run(cleared.log) as run, RecordedRun(run) as found:
        again = Session(found.recipe(), record=Recording(tmp_path)).run()
    assert again.digest == cleared.digest
    with Run(again.log) as run:
        assert scene_of(run.log) is not None, "explain reads the scene from the log alone"


FEED = """\
picktree: 1
kind: scene
base: totes
checkpoint_every: 1
cameras: {overhead: {size: [320, 240]}}
spawn: [{of: {assortment: 1}, colours: [red, blue], into: tote, drop: heap}]
feed: [{of: {assortment: 2}, colours: [red, blue], into: tote, total: 2}]
"""


@pytest.fixture(scope="module")
def fed(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A run of the example that ends with the tote in which the second thing was placed."""
    folder = tmp_path_factory.mktemp("fed")
    (folder / "few.yaml").write_text(FEED)
    request = RunRequest(
        EXAMPLES / "feed_from_totes.yaml",
        str(folder / "few.yaml"),
        seed=SEED,
        parameters={"items": "2"},
        out=folder,
    )
    return Session(request).run()


def test_totes_come_and_go(fed: RunResult) -> None:
    assert fed.feed is not None
    assert (fed.status, fed.feed.exchanges, fed.feed.deliveries) == (
        "success",
        fed.feed.deliveries,
        fed.feed.exchanges,
    )
    assert fed.feed.exchanges >= 1
    assert fed.items.sorted >= 2


def test_a_run_with_another_tote_goes_on_from_a_checkpoint(fed: RunResult, tmp_path: Path) -> None:
    with Run(fed.log) as run, RecordedRun(run) as found:
        emptied = [at.time for at in run.events if isinstance(at.record, BinEmptiedEvent)]
        later = [name for name in found.checkpoints() if found.state(name).time > emptied[0]]
        goes_on_from(found, later[0], tmp_path)
    with Run(next(tmp_path.glob("*/log.mcap"))) as other:
        assert other.info.continues is not None
        assert other.info.continues.time > emptied[0], "things of the second tote come from the checkpoint"


def test_it_goes_on_with_the_heap_that_was_seen(recorded: RecordedRun, tmp_path: Path) -> None:
    name = recorded.checkpoints()[0]
    assert recorded.run.result is not None
    items = recorded.run.result.items
    assert (recorded.run.result.status, items.sorted, items.misplaced) == ("success", 2, 0)
    assert set(recorded.state(name).heaps) == {"tote"}
    goes_on_from(recorded, name, tmp_path)


def goes_on_from(recorded: RecordedRun, name: str, tmp_path: Path) -> None:
    """Resume a run from a checkpoint: digest and messages are those of the recorded run."""
    run, state = recorded.run, recorded.state(name)
    assert run.result is not None
    again = Session(recorded.from_checkpoint(name, state), record=Recording(tmp_path)).run()
    assert again.digest == run.result.digest
    with Run(again.log) as other:
        assert other.info.continues is not None
        new = [(m.topic, m.time, m.data) for m in simulated_messages(other.log)]
        before = simulated_messages(run.log, other.info.continues.time)
        assert new == [(m.topic, m.time, m.data) for m in before]
        assert len(new) > 100

"""A recorded run goes on from a checkpoint with changes, and both outcomes are compared."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from picktree.analysis import Run, RunChanges, what_if
from picktree.analysis.whatif import Continuation
from picktree.files import PicktreeError
from picktree.logs import RunResult
from picktree.session import RunRequest, Session
from picktree.world.event_types import FaultEvent

MISSION = """\
picktree: 1
kind: mission
name: hasty
scene: sort_small
trees:
  Main:
    ports: {policy: {type: string, default: fail, doc: what to do when an item cannot be had}}
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach: {in: "{items}", out: "{item}", on_failure: "{policy}", do: {SortOne: {item: "{item}"}}}
      - GoTo: {pose: home}
  SortOne:
    ports: {item: {type: object}}
    Sequence:
      - Grasp: {object: "{item}"}
      - Place: {object: "{item}", into: "{item.destination}"}
"""
CAREFUL = MISSION.replace(
    """\
    Sequence:
      - Grasp: {object: "{item}"}
      - Place: {object: "{item}", into: "{item.destination}"}
""",
    """\
    Recover:
      attempts: 2
      do:
        Sequence:
          - Grasp: {object: "{item}"}
          - Place: {object: "{item}", into: "{item.destination}"}
      when:
        world.disturbed: [SafeRetreat, {Observe: {camera: overhead}}]
""",
)
SCENE = "picktree: 1\nkind: scene\nbase: sort_small\ncheckpoint_every: 1\n"
FAULTS = """\
picktree: 1
kind: faults
faults:
  - {fault: bump, when: {node: Grasp, start: 3, delay: 500 ms}, target: {nearest_to: object},
     velocity: [0, 0.6, 0]}
"""
GRASP = "Main/Sequence/ForEach/SortOne/Sequence/Grasp"


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The third item is bumped away before it is grasped, and nothing recovers."""
    folder = tmp_path_factory.mktemp("failed")
    for name, text in (("hasty.yaml", MISSION), ("often.yaml", SCENE), ("faults.yaml", FAULTS)):
        (folder / name).write_text(text)
    request = RunRequest(
        folder / "hasty.yaml",
        scene=str(folder / "often.yaml"),
        seed=3,
        faults=folder / "faults.yaml",
        out=folder,
        backend="kinematic",
    )
    return Session(request).run()


def test_the_same_mission_goes_on_identically(failed: RunResult, tmp_path: Path) -> None:
    assert (failed.status, failed.items.sorted) == ("failure", 2)
    found = what_if(failed.log, "5 s", out=tmp_path)
    assert (found.checkpoint, found.items_done) == ("checkpoint-0001.json", 1)
    assert (found.identical, found.exact, found.nodes) == (True, True, None)
    assert found.ticks == found.recorded_ticks > 50
    assert found.now.digest == failed.digest


@pytest.fixture(scope="module")
def turned(failed: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Continuation:
    folder = tmp_path_factory.mktemp("turned")
    (folder / "careful.yaml").write_text(CAREFUL)
    end = f"{failed.sim_seconds:.2f}s"
    return what_if(failed.log, end, changes=RunChanges(mission=folder / "careful.yaml"), out=folder)


def test_another_recovery_turns_the_outcome(turned: Continuation) -> None:
    found = turned
    assert (found.checkpoint, found.items_done) == ("checkpoint-0002.json", 2)
    assert (found.recorded.status, found.recorded.items_sorted) == ("failure", 2)
    assert (found.now.status, found.now.items_sorted) == ("success", 4)
    assert found.now.failures["world.disturbed"] == 1
    assert found.now.recoveries == 1
    assert found.nodes is not None
    top = "Main/Sequence/ForEach/SortOne"
    assert found.nodes.kept == 6
    assert found.nodes.fresh[:2] == (f"{top}/Recover", f"{top}/Recover/Sequence")
    assert found.nodes.gone == (f"{top}/Sequence", f"{top}/Sequence/Grasp", f"{top}/Sequence/Place")
    assert found.difference is not None
    assert found.difference.time > found.start
    with Run(found.new_log) as run:
        assert run.log.attachment("mission.yaml").decode() == CAREFUL
        grasps = [v for v in run.visits if v.id == "Grasp" and v.outcome == "FAILURE"]
        assert [v.cause for v in grasps] == ["world.disturbed"]
        assert run.result is not None
        assert run.result.items.sorted == 4


def test_what_is_said_of_it(turned: Continuation) -> None:
    text = turned.to_text()
    assert "changed     mission line 14: 8 lines instead of 3, `Recover:` instead of `Sequence:`\n" in text
    assert "the runs diverge at 8.10 s (A: recorded, B: what if): SortOne ends differently" in text
    assert json.loads(turned.to_json_text())["new_log"] == str(turned.new_log)


def test_without_the_fault_it_would_have_gone_well(failed: RunResult, tmp_path: Path) -> None:
    found = what_if(failed.log, "130", changes=RunChanges(no_faults=True), out=tmp_path)
    assert found.changes == ("faults: none instead of 1",)
    assert (found.now.status, found.now.items_sorted, found.now.failures) == ("success", 4, {})


def test_a_fault_that_is_switched_off_keeps_its_place(failed: RunResult, tmp_path: Path) -> None:
    off = tmp_path / "off.yaml"
    off.write_text(FAULTS.replace("{fault: bump,", "{fault: bump, off: true,"))
    found = what_if(failed.log, f"{failed.sim_seconds:.2f}s", changes=RunChanges(faults=off), out=tmp_path)
    assert (found.status, found.now.items_sorted) == ("success", 4)


def test_a_part_is_nominal_whatever_the_faults_are(failed: RunResult, tmp_path: Path) -> None:
    with Run(failed.log) as run:
        bumped = next(at.record.item for at in run.events if isinstance(at.record, FaultEvent))
    changes = RunChanges(nominal=(f"place {bumped}",))
    found = what_if(failed.log, "130", changes=changes, out=tmp_path)
    assert found.changes == (f"nominal: place {bumped}",)
    assert (found.now.status, found.now.items_sorted, found.now.failures) == ("success", 4, {})
    with Run(found.new_log) as run:
        assert run.info.nominal == (f"place {bumped}",)
    again = what_if(found.new_log, f"{failed.sim_seconds:.2f}s", out=tmp_path)
    assert again.identical and again.exact
    with pytest.raises(PicktreeError, match="there is no 'overhed'"):
        what_if(failed.log, "130", changes=RunChanges(nominal=("camera overhed",)), out=tmp_path)


def test_noise_and_planner_seeds_differ_from_the_asked_time_on(failed: RunResult, tmp_path: Path) -> None:
    with Run(failed.log) as run:
        second = [visit.start for visit in run.visits if visit.id == "Grasp"][1]
    found = what_if(failed.log, f"{second:.2f}s", changes=RunChanges(variant=1), out=tmp_path)
    assert found.start < second
    assert found.difference is not None
    with Run(failed.log) as run:
        assert found.difference.tick >= run.ticks.number_at(second)
    with Run(found.new_log) as run:
        assert run.info.variant is not None
        assert (run.info.variant.number, run.info.variant.since) == (1, pytest.approx(second))
    again = what_if(found.new_log, f"{second + 1.0:.2f}s", out=tmp_path)
    assert again.identical and again.exact


def test_a_parameter_counts_for_what_runs_at_the_checkpoint(failed: RunResult, tmp_path: Path) -> None:
    found = what_if(failed.log, "130", changes=RunChanges(settings={"policy": "continue"}), out=tmp_path)
    assert found.changes == ("set policy: continue",)
    assert (found.now.status, found.now.items_sorted) == ("incomplete", 3)
    with Run(found.new_log) as run:
        assert run.blackboard_at(found.start)["Main/policy"] == "continue"


def test_before_the_first_checkpoint_it_begins_anew(failed: RunResult, tmp_path: Path) -> None:
    found = what_if(failed.log, "0", out=tmp_path)
    assert (found.checkpoint, found.start, found.identical) == ("", 0.0, True)
    assert (
        "goes on     from the beginning: there is no checkpoint at or before tick 0 (0.00 s)"
        in found.to_text()
    )


def test_a_what_if_of_a_what_if(turned: Continuation, tmp_path: Path) -> None:
    first = turned
    second = what_if(first.new_log, f"{first.now.end:.2f}s", out=tmp_path)
    assert (second.identical, second.exact, second.items_done) == (True, True, 3)
    assert second.now.digest == first.now.digest


def test_seed_and_scene_stay_as_they_were(failed: RunResult) -> None:
    with pytest.raises(PicktreeError) as caught:
        what_if(failed.log, "130", changes=RunChanges(seed=4))
    assert str(caught.value) == "a what-if keeps the seed and the scene of the run; `resim` takes others"


def test_a_faulty_mission_is_refused_before_anything_runs(failed: RunResult, tmp_path: Path) -> None:
    faulty = tmp_path / "faulty.yaml"
    faulty.write_text(MISSION.replace("Place", "Plaice"))
    with pytest.raises(PicktreeError, match=r"faulty\.yaml:16:9: .*unknown node 'Plaice'"):
        what_if(failed.log, "130", changes=RunChanges(mission=faulty), out=tmp_path / "runs")
    assert not (tmp_path / "runs").exists()

"""Root causes of runs in which something was made to go wrong, found without the events of the faults."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.explain import Explanation, explain
from picktree.logs import Stamped
from picktree.session import RunRequest, Session
from picktree.simulation import Backend
from picktree.world import JournalEvent

MISSION = """
picktree: 1
kind: mission
scene: scene.yaml
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach:
          in: "{items}"
          out: "{item}"
          on_failure: continue
          do:
            Recover:
              attempts: 2
              do:
                - Grasp: {object: "{item}"}
                - Place: {object: "{item}", into: "{item.destination}"}
              otherwise: [SafeRetreat, {Observe: {camera: overhead}}]
              give_up: {SafeRetreat: {hand: open}}
"""
REWEIGH = """
from dataclasses import replace

from picktree.skills.plugin import In, ObjectId, Out, Skill, Steps, World, port


class Reweigh(Skill):
    '''Believe a wrong mass, read the destination, and believe the true mass.'''

    object: In[ObjectId] = port("held object")
    bin: Out[ObjectId] = port("its destination")
    uses = ()
    example = 'Reweigh: {object: "{item}", bin: "{bin}"}'

    def run(self, world: World) -> Steps:
        for mass in (0.06, 0.1):
            world.scene.put(replace(world.scene.get(self.object), mass=mass), "weighed")
            for _ in range(10):
                yield
            if mass < 0.1:
                self.bin = world.scene.destination(self.object)


NODES = (Reweigh,)
"""
BALL = "  - {of: {ball: 1}, colours: [red], area: {min: [0.44, -0.1], max: [0.46, -0.08]}}\n"
BLOCK = "  - {of: {block: 1}, colours: [blue], area: {min: [0.5, 0.1], max: [0.52, 0.12]}}\n"


class Blind(Run):
    """A run whose log holds no word of a fault."""

    @cached_property
    def events(self) -> tuple[Stamped[JournalEvent], ...]:
        return tuple(at for at in super().events if at.record.kind != "fault")


def run(
    folder: Path,
    *,
    items: str = BALL + BLOCK,
    scene: str = "",
    mission: str = MISSION,
    fault: str = "",
    backend: Backend = "kinematic",
    limit: float = 100.0,
) -> Path:
    """The folder of a run with these items on the table."""
    (folder / "mission.yaml").write_text(mission, encoding="utf-8")
    text = f"picktree: 1\nkind: scene\nbase: sort_small\n{scene}spawn:\n{items}"
    (folder / "scene.yaml").write_text(text, encoding="utf-8")
    (folder / "faults.yaml").write_text(
        f"picktree: 1\nkind: faults\nfaults:\n  - {fault}\n", encoding="utf-8"
    )
    request = RunRequest(
        mission=folder / "mission.yaml",
        backend=backend,
        faults=folder / "faults.yaml" if fault else None,
        out=folder,
        limit=limit,
    )
    return Session(request).run().folder


def blind(folder: Path) -> Explanation:
    with Blind(folder) as log:
        return explain(log)


def test_an_item_that_was_taken_away(tmp_path: Path) -> None:
    fault = "{fault: remove, when: {node: Grasp, delay: 500 ms}, target: {nearest_to: object}}"
    folder = run(tmp_path, fault=fault)
    (cause,) = blind(folder).root_causes
    assert (cause.cause, cause.item, cause.failures, cause.ended_run) == (
        "item.gone",
        "red_ball_1",
        (0, 1),
        True,
    )
    assert cause.title == (
        "red_ball_1 was taken away between 0.6 and 0.8 s: the robot's belief does not contain it any more"
    )
    assert cause.reasons == (
        "the log has its true place until 0.60 s (x 0.44, y -0.09 m), and not after that",
        "the fingers met (0.0 mm) and hold nothing",
        "at 8.65 s its place was seen empty, and the robot gave it up",
    )
    assert cause.planted == ()
    with Run(folder) as log:
        (told,) = log.explanation.root_causes
        assert told.planted == ("at 0.65 s: item_00 is snatched away",)
        assert (told.title, told.reasons) == (cause.title, cause.reasons)
        (hidden,) = explain(log, faults=False).root_causes
        assert hidden == cause
        missed, unknown = log.failures
        gone = next(item for item in log.explanation.items if item.id == "red_ball_1")
    assert (missed.fate, unknown.because_of, missed.root_cause) == ("passed_over", 0, 0)
    assert "truth: red_ball_1 is nowhere any more" in missed.observed
    assert any(line.startswith("planted: item_00 is snatched away") for line in missed.observed)
    assert (gone.state, gone.truth) == ("gone", "truly nowhere any more")
    assert [event.what for event in gone.events] == [
        "seen for the first time, at x 0.45, y -0.09 m",
        "Grasp failed: grasp.missed",
        "given up: its place was seen empty",
        "Grasp failed: world.unknown_object",
        "passed over",
    ]


def test_an_item_that_was_pushed_away_and_found_again(tmp_path: Path) -> None:
    when = "when: {node: Grasp, delay: 300 ms}, target: {nearest_to: object}"
    fault = f"{{fault: bump, {when}, velocity: [0, 0.9, 0]}}"
    found = blind(run(tmp_path, fault=fault))
    (cause,) = found.root_causes
    assert (found.outcome.status, cause.cause, cause.ended_run) == ("success", "item.moved", False)
    assert cause.title == (
        "red_ball_1 was not where it was believed to be: it had moved by 7 cm between 0.4 and 0.6 s"
    )
    (failure,) = found.failures
    assert failure.cured
    assert found.look_at[-1].why == "Grasp of red_ball_1 fails: grasp.missed"


def test_an_item_that_vanished_from_its_bin_without_any_failure(tmp_path: Path) -> None:
    fault = "{fault: remove, when: {node: Grasp, start: 2, delay: 1 s}, target: {kind: ball}}"
    found = blind(run(tmp_path, fault=fault))
    (cause,) = found.root_causes
    assert (found.failures, cause.failures, cause.ended_run) == ((), (), True)
    assert cause.title.startswith(
        "red_ball_1 was taken away out of red_bin, where it had been placed, between"
    )
    assert cause.reasons[-1] == "nothing failed: the robot still believed that it was there"


@pytest.mark.parametrize(
    ("scene", "items", "cause", "title", "reason"),
    [
        (
            "fixtures:\n  post: {box: [0.02, 0.3, 0.3], at: [0.41, -0.09, 0.15]}\n"
            "  rail: {box: [0.02, 0.3, 0.3], at: [0.49, -0.09, 0.15]}\n",
            BALL.replace("}}", "}, gap: 5 mm}"),
            "scene.blocked",
            "post is in the way of the hand at red_ball_1",
            "in 440 of 832 grasps the hand would touch post",
        ),
        (
            "",
            "  - {of: {ball: 1}, colours: [red], area: {min: [0.4, -0.75], max: [0.42, -0.73]}}\n",
            "item.never_seen",
            "the red ball (item_00) was never seen: it lies at x 0.40, y -0.74 m",
            "it lies outside the picture of overhead",
        ),
    ],
)
def test_what_stands_in_the_scene(
    tmp_path: Path, scene: str, items: str, cause: str, title: str, reason: str
) -> None:
    (found,) = blind(run(tmp_path, scene=scene, items=items)).root_causes
    assert (found.cause, found.title) == (cause, title)
    assert reason in found.reasons
    assert found.ended_run


def test_a_mission_that_says_the_wrong_bin(tmp_path: Path) -> None:
    mission = MISSION.replace('into: "{item.destination}"', "into: red_bin")
    found = blind(run(tmp_path, items=BLOCK, mission=mission))
    (cause,) = found.root_causes
    assert (cause.cause, cause.failures) == ("mission.wrong_bin", ())
    assert cause.title == (
        "the mission takes items into red_bin that belong into blue_bin: Place of blue_block_1 says so"
    )
    assert cause.reasons == (
        "Main/Sequence/ForEach/Recover/Sequence/Place has into: red_bin",
        "by the scene's rules a blue block belongs into blue_bin",
    )
    assert [item.truth for item in found.items] == ["truly in red_bin; it belongs into blue_bin"]


def test_a_destination_that_followed_from_a_wrong_weighing(tmp_path: Path) -> None:
    scene = (
        'destinations:\n  - {where: "mass < 0.07", to: red_bin}\n'
        "  - {where: \"colour == 'blue'\", to: blue_bin}\n"
    )
    (tmp_path / "reweigh.py").write_text(REWEIGH, encoding="utf-8")
    mission = (
        MISSION.replace("scene: scene.yaml\n", "scene: scene.yaml\nplugins: [reweigh.py]\n")
        .replace("- Place", '- Reweigh: {object: "{item}", bin: "{bin}"}\n                - Place')
        .replace("{item.destination}", "{bin}")
    )
    (cause,) = blind(run(tmp_path, items=BLOCK, mission=mission, scene=scene)).root_causes
    assert cause.cause == "perception.mistaken"
    assert cause.title == (
        "blue_block_1 was placed into red_bin and belongs into blue_bin: 60 g were felt, and it weighs 100 g"
    )
    assert cause.reasons[-1] == "later 100 g were felt; its bin had been chosen by then"


def test_a_run_that_was_ended_at_its_limit(tmp_path: Path) -> None:
    found = blind(run(tmp_path, limit=2.0))
    assert found.outcome.sentence == (
        "the run was ended at its limit of time while Place of red_ball_1 was running; "
        "0 of 2 items are where they belong, 2 left"
    )
    (cause,) = found.root_causes
    assert (cause.cause, cause.ended_run) == ("run.limit", True)
    assert cause.title == "the run was ended at its limit of simulated time, 2.00 s"
    assert cause.reasons[0].startswith("what ran then: Place of red_ball_1 (for ")


def test_an_oiled_item_by_what_the_hand_feels(tmp_path: Path) -> None:
    fault = "{fault: friction, when: {node: Grasp}, target: {nearest_to: object}, friction: 0.01}"
    gentle = MISSION.replace('Grasp: {object: "{item}"}', 'Grasp: {object: "{item}", force: 30 N}')
    found = blind(run(tmp_path, items=BLOCK, mission=gentle, fault=fault, backend="physics"))
    (cause,) = found.root_causes
    assert (cause.cause, cause.item) == ("item.slippery", "blue_block_1")
    assert cause.title.startswith("blue_block_1 is slipperier than its kind: its friction is 0.01")
    assert cause.reasons[0] == "by the catalogue a block has 0.60"
    assert cause.reasons[1].startswith("truly it left the fingers between ")


def test_a_run_of_which_nothing_is_to_be_said(tmp_path: Path) -> None:
    found = blind(run(tmp_path, items=BLOCK))
    assert (found.outcome.status, found.failures, found.root_causes, found.look_at) == ("success", (), (), ())
    (item,) = found.items
    assert (item.state, item.truth) == ("done", "truly in blue_bin, where it belongs")
    assert [event.what for event in item.events] == [
        "seen for the first time, at x 0.50, y 0.11 m",
        "held (40 mm between the fingers, 1.05 N on the wrist)",
        "placed into blue_bin",
    ]

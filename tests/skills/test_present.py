"""Present: what is in the hand is looked at from near, and two things at once are noticed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.logs import RunResult
from picktree.robot.manipulation.presentation import SeenThing, presenting_poses
from picktree.robot.perception import HeldView, segmentation
from picktree.session import RunRequest, Session
from picktree.world import ObjectId, Pose, greatest_length
from picktree.world.event_types import PresentEvent, PutDownEvent
from picktree.world.scene.description import Destination
from picktree.world.scene.destinations import ItemTraits, unknown_traits

EXAMPLE = Path(__file__).parents[2] / "examples" / "empty_the_tote.yaml"
SCENE = """\
picktree: 1
kind: scene
base: tote
assortment: {meshes: random_urdfs, scale: 0.0092, density: 1500, friction: 0.5, least_mass: 30 g, tags: [1],
             tag_size: 100 mm}   # no face is as wide
spawn: [{of: {assortment: 2}, colours: [red, blue], into: tote, drop: heap}]
destinations:
  - {where: "tag == 1", to: red_bin}
  - {where: "kind == 'unknown'", to: rejects}
"""
PUT_BACK = """\
picktree: 1
kind: mission
name: put back
scene: scene.yaml
goal: left == 1
trees:
  Main:
    Sequence:
      - PickAny: {from: tote, out: "{thing}"}
      - Place: {object: "{thing}", into: tote}
"""


@pytest.fixture(scope="module")
def presented(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("present")
    (folder / "scene.yaml").write_text(SCENE)
    return Session(RunRequest(EXAMPLE, str(folder / "scene.yaml"), seed=3, out=folder)).run()


def test_a_thing_without_a_known_class_is_seen_from_both_sides(presented: RunResult) -> None:
    with Run(presented.log) as run:
        events = [at for at in run.events if isinstance(at.record, PresentEvent)]
        whole = [at for at in events if isinstance(at.record, PresentEvent) and at.record.whole]
        assert whole
        for at in whole:
            assert isinstance(at.record, PresentEvent) and at.record.size is not None
            truth = run.at(at.time + 1.0).truth
            belief = run.at(at.time).belief
            assert truth is not None and belief is not None
            held = next(body for body in belief.bodies if body.attached)
            true = min(truth.bodies, key=lambda body: -body.pose.position[2])
            assert at.record.colours == (true.colour,)
            assert at.record.size == pytest.approx(greatest_length(true.shape), abs=0.012)
            assert greatest_length(held.shape) < greatest_length(true.shape) + 0.03


def test_explain_tells_that_a_tag_was_not_read(presented: RunResult) -> None:
    assert presented.items.misplaced > 0
    with Run(presented.log) as run:
        titles = [root.title for root in run.explanation.root_causes]
    assert any("its tag was not read, and it has tag 1" in title for title in titles)


def test_what_is_put_back_is_a_part_of_the_heap(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE.replace("assortment: 2", "assortment: 1"))
    (tmp_path / "put_back.yaml").write_text(PUT_BACK)
    result = Session(RunRequest(tmp_path / "put_back.yaml", seed=3, out=tmp_path)).run()
    assert result.status == "success"
    with Run(result.log) as run:
        belief = run.at(run.end).belief
        told = [at.record.message for at in run.events if isinstance(at.record, PutDownEvent)]
    assert belief is not None
    assert [body.id for body in belief.bodies if body.role == "item"] == []
    assert told == ["thing_1 is put back into tote"]


CAMERA = Pose.from_rpy((0.5, 0.1, 0.85), (math.pi, 0.0, 0.3))


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("tilt", [0.0, math.radians(45.0)])
def test_fingers_are_beside_the_line_of_sight(side: int, tilt: float) -> None:
    centre = np.array([0.01, 0.0, 0.02])
    ahead = CAMERA.rotation()[:, 2]
    poses = list(presenting_poses(CAMERA, 0.3, tilt, centre, side))
    assert len(poses) == 12
    for pose in poses:
        x, y, z = pose.rotation().T
        assert pose.apply(centre) == pytest.approx(CAMERA.apply(np.array([0.0, 0.0, 0.3])), abs=1e-9)
        assert abs(float(y @ ahead)) < 1e-9
        assert float(z @ -ahead) == pytest.approx(math.sin(tilt), abs=1e-9)
        assert math.copysign(1, float(x @ -ahead)) == side
        assert np.linalg.det(pose.rotation()) == pytest.approx(1.0)


def view(*colours: str, tags: tuple[int, ...] = ()) -> HeldView:
    """Return a view of a 40 mm cube with equal shares of these colours."""
    points = np.random.default_rng(1).uniform(-0.02, 0.02, (600, 3))
    labels = np.array([segmentation.label_of(colours[k % len(colours)]) for k in range(600)], np.uint8)
    return HeldView(points, np.full(600, 1e-6), labels, np.ones(600, np.intp), tags)


def test_two_colours_or_two_tags_are_two_things() -> None:
    assert SeenThing.of([view("red"), view("red", tags=(2,))]).double == ""
    assert SeenThing.of([view("red"), view("blue")]).double == "red and blue surfaces"
    assert SeenThing.of([view("red", tags=(1,)), view("red", tags=(2,))]).double == "tags 1, 2"
    # A few pixels of another colour are the edge of something else.
    assert SeenThing.of([view(*["red"] * 19, "blue")]).double == ""


def test_only_what_a_rule_before_asks_for_is_missing() -> None:
    rules = [
        Destination("mass > 0.1 and colour == 'red'", ObjectId("a")),
        Destination("colour == 'blue'", ObjectId("b")),
        Destination("tag == 3", ObjectId("c")),
    ]
    assert unknown_traits(rules, ItemTraits("blue", "mesh", "unknown", 0.05)) == ()
    assert unknown_traits(rules, ItemTraits("grey", "mesh", "unknown")) == ("mass", "colour", "tag")
    assert unknown_traits(rules, ItemTraits("red", "mesh", "unknown", 0.05)) == ("tag",)

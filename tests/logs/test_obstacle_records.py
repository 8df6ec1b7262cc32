"""Obstacles in logs and checkpoints: what they take up comes back as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import TypeAdapter

from picktree.logs import encode
from picktree.logs.binary_gltf import parts_of
from picktree.logs.log_records import BodyRecord, Scene, decode
from picktree.logs.recording import belief_record
from picktree.logs.recording.foxglove_messages import SceneMessages, read_scene
from picktree.logs.recording.journal_records import truth_record
from picktree.robot.perception.obstacle_volumes import (
    cells_in_body,
    cells_of,
    merge_cells,
    obstacle_from_cells,
)
from picktree.simulation import TrueObstacle
from picktree.world import BeliefObject, Box, ObjectId, PlanningScene, Pose, SceneSnapshot
from picktree.world.scene import Fixture

CELLS = cells_in_body(Box((0.08, 0.06, 0.3)), Pose.from_rpy((0.5, 0.2, 0.15), (0.0, 0.0, 0.5)))
SHAPE, POSE, BLOCKS = obstacle_from_cells(merge_cells(CELLS))
OBSTACLE = BeliefObject(
    "unknown",
    "unknown",
    SHAPE,
    "grey",
    POSE,
    0.005,
    0.1,
    0.5,
    1.5,
    id=ObjectId("obstacle_1"),
    role="obstacle",
    blocks=BLOCKS,
)


def test_a_checkpoint_holds_it_exactly() -> None:
    scene = PlanningScene((), ())
    scene.put(OBSTACLE, "test")
    adapter = TypeAdapter(SceneSnapshot)
    again = PlanningScene((), ())
    again.restore(adapter.validate_json(adapter.dump_json(scene.snapshot())), {"obstacle": 1})
    assert again.objects == scene.objects
    assert np.array_equal(cells_of(again.get("obstacle_1")), CELLS)
    assert again.new_id("obstacle") == "obstacle_2"


def test_the_log_holds_its_blocks_and_viewers_draw_them() -> None:
    body = belief_record(OBSTACLE)
    (read,) = read_scene(SceneMessages(locked=True).encode(0, Scene((body,), ()))).bodies
    assert read == body
    assert [shape.size for shape, _ in parts_of(read) if isinstance(shape, Box)] == [b.size for b in BLOCKS]


def test_a_body_of_an_older_log_has_none() -> None:
    data = encode(replace(belief_record(OBSTACLE), blocks=(), shape=Box((0.1, 0.1, 0.1))))
    older = decode(BodyRecord, data.replace(b',"blocks":[]', b""))
    assert older.blocks == ()
    assert parts_of(older) == ((Box((0.1, 0.1, 0.1)), Pose()),)


def test_the_truth_says_that_it_is_no_item() -> None:
    thing = Fixture(ObjectId("post"), Box((0.1, 0.1, 0.3)), Pose((0.5, 0.2, 0.15)), "red")
    body = truth_record(TrueObstacle.of(thing))
    assert (body.id, body.role, body.shape, body.colour) == ("post", "obstacle", thing.shape, "red")

"""First rule: belief is not truth. Decisions see the planning scene and sensors, and nothing else."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pybullet as pb
import pytest

from picktree.simulation import Backend
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import ObjectId, RgbdImage, Vector3
from picktree.world.scene import load_scene

from .rooms import ROOT, modules
from .skills.cell import Cell, items, mission, sorting

TRUTH = {"truth", "recent_truth", "initial_truth", "true_tcp", "true_contacts", "change_dynamics", "bump"}
"""What only the simulation, its scorer, its faults and the analyst's record may ask or do."""
LOOK = "Sequence: [{Observe: {camera: overhead}}]"


def modules_that_decide() -> list[Path]:
    """Everything on the floors below the session, besides the simulation."""
    return [
        path
        for path in modules(
            but=("analysis", "apps/batch", "apps/cli", "apps/commissioning", "logs", "session")
        )
        if "simulation" not in path.parts
    ]


def test_nothing_that_decides_asks_for_the_truth() -> None:
    """The import contract keeps `world.simulation` out of reach; this, what hardware carries with it."""
    texts = {path: path.read_text(encoding="utf-8") for path in modules_that_decide()}
    asked = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.attr}"
        for path, text in texts.items()
        if any(name in text for name in TRUTH)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Attribute) and node.attr in TRUTH
    ]
    assert asked == []


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_a_mission_succeeds_while_the_truth_refuses_to_be_asked(
    backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = Cell(sorting(), items(block=1, can=1), backend)
    with monkeypatch.context() as patch:
        for name in ("truth", "true_tcp"):

            def refuse(asked: str = name) -> None:
                raise AssertionError(f"{asked} was asked for during the run")

            patch.setattr(cell.hardware, name, refuse)
        cell.finish()
    assert (cell.tree.status.value, cell.tree.failure) == ("SUCCESS", None)
    assert cell.score().count.sorted == 2


def test_an_image_holds_colour_depth_and_stamp_and_no_segmentation() -> None:
    names = {field.name for field in fields(RgbdImage)}
    assert names == {"camera", "colour", "depth", "stamp", "intrinsics", "camera_in_world"}


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_no_camera_lets_pybullet_draw_a_segmentation(
    backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    flags: list[int] = []
    draw = pb.getCameraImage

    def spy(*args: object, **options: int) -> object:
        flags.append(options.get("flags", 0))
        return draw(*args, **options)

    monkeypatch.setattr(pb, "getCameraImage", spy)
    cell = Cell(mission(LOOK), items(block=1), backend)
    cell.finish()
    assert flags
    assert all(flag & pb.ER_NO_SEGMENTATION_MASK for flag in flags)


def moved(cell: Cell, to: Vector3 | None) -> None:
    """Behind the robot's back: the only item somewhere else, or taken away."""
    hardware = cell.hardware
    assert isinstance(hardware, KinematicHardware)
    (body,) = hardware.bodies.items
    if to is None:
        hardware.remove(body.id)
    else:
        hardware.bodies.put(replace(body, pose=replace(body.pose, position=to)))


def test_the_belief_follows_a_moved_item_when_it_is_observed_and_not_before() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    cell.finish()
    (seen,) = cell.world.scene.objects
    version = cell.world.scene.version
    x, y, z = seen.pose.position
    moved(cell, (x + 0.03, y - 0.02, z))

    cell.start(mission("Sequence: [{GoTo: {pose: rest}}, CloseGripper, {GoTo: {pose: home}}]"))
    cell.finish()
    assert cell.world.scene.objects == (seen,)
    assert cell.world.scene.version == version

    cell.start(mission(LOOK))
    cell.finish()
    (again,) = cell.world.scene.objects
    assert again.id == seen.id
    assert np.linalg.norm(np.subtract(again.pose.position, (x + 0.03, y - 0.02, z))) < 0.003


def test_an_item_that_is_gone_is_believed_in_until_its_place_is_seen_empty() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    cell.finish()
    (seen,) = cell.world.scene.objects
    moved(cell, None)
    cell.start(mission(f"Grasp: {{object: {seen.id}}}"))
    cell.finish()
    assert cell.tree.failure is not None
    assert cell.tree.failure.cause.name == "grasp.missed"
    assert cell.world.scene.find(seen.id) == seen
    cell.start(mission("Sequence: [{GoTo: {pose: home}}, {Observe: {camera: overhead}}]"))
    cell.finish()
    assert cell.world.scene.objects == ()


def test_the_belief_has_the_cameras_errors_and_not_the_truths_numbers() -> None:
    cell = Cell(mission(LOOK), load_scene("sort_small"), "physics")
    cell.finish()
    truth = {(body.kind, body.colour): body.pose.position for body in cell.hardware.truth()}
    off = [
        float(np.linalg.norm(np.subtract(o.pose.position, truth[o.kind, o.colour])))
        for o in cell.world.scene.objects
    ]
    assert len(off) == 4
    assert all(1e-6 < each < 0.005 for each in off)
    assert not {o.id for o in cell.world.scene.objects} & {ObjectId(b.id) for b in cell.hardware.truth()}

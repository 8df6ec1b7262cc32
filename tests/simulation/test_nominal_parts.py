"""Nominal parts of a simulation: no fault affects them, and the other faults act as before."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files import PicktreeError
from picktree.simulation import (
    Backend,
    FaultInjector,
    NominalPart,
    build_hardware,
    make_nominal,
    nominal_scene,
    parse_faults,
)

from .simulated_cell import cell, panda

FAULTS = """\
picktree: 1
kind: faults
faults:
  - {fault: friction, when: {at: 0 s}, target: {index: 0}, friction: 0.05, mass: 2 kg}
  - {fault: larger, when: {at: 0 s}, target: {index: 0}, factor: 1.1}
  - {fault: gripper_weak, when: {at: 0 s}, share: 0.5}
  - {fault: joint_weak, when: {at: 0 s}, joint: panda_joint4, share: 0.5}
  - {fault: obstacle, when: {at: 0 s}, name: post, body: {box: [0.02, 0.02, 0.1], at: [0.3, -0.4, 0.05]}}
  - {fault: camera_noise, when: {at: 0 s}, camera: overhead, factor: 3}
"""
BOTH = pytest.mark.parametrize("backend", ["kinematic", "physics"])


def held(backend: Backend, *words: str):
    """Return a simulation after its faults, with these parts nominal, and the messages of the faults."""
    parts = tuple(map(NominalPart.from_words, words))
    hardware = build_hardware(backend, nominal_scene(cell(), parts), panda(), 1)
    faults = parse_faults(FAULTS, Path("faults.yaml"))
    injector = FaultInjector(faults, hardware, seed=1, nominal=parts)
    return hardware, injector, [event.message for event in injector.tick()]


@BOTH
def test_a_property_is_nominal_and_the_others_are_not(backend: Backend) -> None:
    hardware, _, _ = held(backend, "friction item_00", "size item_00")
    item = hardware.recent_truth()[0]
    entry = cell().entry(item.kind)
    assert (hardware.friction_of("item_00"), item.mass, item.shape) == (entry.friction, 2.0, entry.shape)


@BOTH
def test_a_device_is_nominal_and_the_others_are_not(backend: Backend) -> None:
    hardware, injector, told = held(backend, "gripper", "joint panda_joint4", "camera", "body post")
    assert (hardware.faults.grip_share, hardware.faults.torque_shares) == (1.0, {})
    assert (hardware.faults.cameras, hardware.obstacles()) == ({}, ())
    assert told[-1] == "camera_noise has no effect: its target is held nominal"
    restored = FaultInjector(parse_faults(FAULTS, Path("faults.yaml")), hardware, seed=1)
    assert not any(state.standing for state in injector.state())
    restored.restore(injector.state())


@BOTH
def test_what_faults_have_changed_before_is_as_in_the_catalogue_again(backend: Backend) -> None:
    hardware, _, _ = held(backend)
    item = hardware.recent_truth()[0]
    entry = cell().entry(item.kind)
    assert (item.mass, hardware.friction_of("item_00")) == (2.0, 0.05)
    words = ("mass item_00", "friction item_00", "size item_00", "body post")
    make_nominal(hardware, cell(), tuple(map(NominalPart.from_words, words)))
    now = hardware.recent_truth()[0]
    assert (now.mass, hardware.friction_of("item_00")) == (entry.mass, entry.friction)
    assert (now.size, hardware.obstacles()) == (pytest.approx(cell_size(entry.kind)), ())


def cell_size(kind: str) -> float:
    return next(
        body.size
        for body in build_hardware("kinematic", cell(), panda(), 1).recent_truth()
        if body.kind == kind
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("griper", "'griper' is no part that can be nominal (did you mean 'gripper'?)"),
        ("joint", "the nominal part 'joint' is to be written as 'joint NAME'"),
        ("wrist left", "the nominal part 'wrist left' is to be written as 'wrist' alone"),
    ],
)
def test_a_wrong_part_is_refused(words: str, message: str) -> None:
    with pytest.raises(PicktreeError) as refused:
        NominalPart.from_words(words)
    assert str(refused.value) == message

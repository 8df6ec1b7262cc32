"""Devices, items and missions at fault: named without the events of the faults, and quoted with them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.explain import Explanation, explain, to_text
from picktree.analysis.explain.device_causes import smooth_spans
from picktree.simulation import Backend
from picktree.simulation.kinematic.camera import KinematicCamera
from picktree.simulation.physics.rgbd_camera import PhysicsCamera
from picktree.world import RgbdImage, known_causes

from ..trees.waving import WAVE, forgotten
from .test_explain_roots import BALL, BLOCK, MISSION, blind, run

CAN = "  - {of: {can: 1}, colours: [green], area: {min: [0.5, 0.1], max: [0.52, 0.12]}}\n"
EACH_IN_TIME = MISSION.replace(
    '                - Grasp: {object: "{item}"}\n',
    '                - Timeout: {msec: 20 s, do: {Grasp: {object: "{item}"}}}\n',
)
FIRST = "when: {node: Grasp, delay: 300 ms}"


@pytest.mark.parametrize(
    ("fault", "cause", "word", "backend"),
    [
        ("{fault: wrench_dead, when: {at: 1 s}, lasts: 2 s}", "wrist.silent", "wrist sensor", "kinematic"),
        ("{fault: camera_drop, when: {at: 0 s}, lasts: 2 s}", "camera.silent", "overhead", "kinematic"),
        ("{fault: camera_mislabel, when: {at: 0 s}, colour: red, shown_as: blue}", "perception.mistaken",
         "is a red ball", "kinematic"),
        ("{fault: hang, when: {node: Grasp, start: 2, delay: 200 ms}}", "skill.hangs", "Grasp of",
         "kinematic"),
        ("{fault: raise, when: {node: Place, delay: 200 ms}}", "internal.error", "Place", "kinematic"),
        (f"{{fault: joint_weak, {FIRST}, joint: panda_joint4, share: 8 %, lasts: 3 s}}", "joint.weak",
         "panda_joint4", "physics"),
        (f"{{fault: stall, {FIRST}, lasts: 2 s}}", "arm.stalled", "no drive followed", "physics"),
        ("{fault: wrench_bias, when: {node: Grasp}, force: [0, 0, 25 N], lasts: 4 s}", "wrist.biased",
         "that were not there", "physics"),
        (f"{{fault: gripper_jam, {FIRST}, lasts: 4 s}}", "gripper.jammed", "stuck at", "physics"),
        ("{fault: gripper_jam, when: {node: Place, delay: 200 ms}, lasts: 5 s}", "gripper.jammed", "stuck at",
         "physics"),
        ("{fault: gripper_weak, when: {node: Grasp}, share: 3 %, lasts: 6 s}", "gripper.weak", "too weak",
         "physics"),
        ("{fault: slip, when: {node: Place, delay: 200 ms}, lasts: 400 ms}", "item.slipped",
         "slid out of the fingers", "physics"),
    ],
)  # fmt: skip
def test_a_fault_is_named_blind_and_quoted_when_shown(
    tmp_path: Path, fault: str, cause: str, word: str, backend: Backend
) -> None:
    folder = run(tmp_path, fault=fault, mission=EACH_IN_TIME, backend=backend)
    first = blind(folder).root_causes[0]
    assert (first.cause, first.planted) == (cause, ())
    assert word in first.title
    with Run(folder) as log:
        told = explain(log).root_causes[0]
        hidden = to_text(log, explain(log, faults=False), "LOG")
    assert (told.cause, told.title) == (first.cause, first.title)
    assert len(told.planted) >= 1
    assert "planted" not in hidden


def test_a_planner_that_refuses_is_not_said_to_have_found_paths(tmp_path: Path) -> None:
    fault = "{fault: no_plan, when: {node: Grasp}, lasts: 3 s}"
    folder = run(tmp_path, fault=fault, mission=EACH_IN_TIME, backend="kinematic")
    first = blind(folder).root_causes[0]
    assert (first.cause, "nothing was in the way" in first.title) == ("planner.refuses", True)
    with Run(folder) as log:
        told = to_text(log, explain(log), "LOG")
    assert "found no path" in told
    assert "path that was found" not in told


def first(found: Explanation) -> tuple[str, str]:
    return found.root_causes[0].cause, found.root_causes[0].title


def test_a_wrong_colour_costs_its_item_and_a_slip_another_one(tmp_path: Path) -> None:
    faults = (
        "{fault: camera_mislabel, when: {at: 0 s}, colour: green, shown_as: blue}\n"
        "  - {fault: slip, when: {node: Place, delay: 200 ms}, lasts: 400 ms}"
    )
    found = blind(run(tmp_path, items=BALL + CAN, fault=faults, backend="physics"))
    mistaken = next(c for c in found.root_causes if c.cause == "perception.mistaken")
    assert (mistaken.ended_run, mistaken.items, mistaken.doubtful) == (True, ("blue_can_1",), False)
    slipped = next(c for c in found.root_causes if c.cause == "item.slipped")
    assert "blue_can_1" not in slipped.items
    assert slipped.title.endswith("though its mass and friction are those of its kind")


def test_what_lies_in_the_bin_is_not_told_to_be_in_the_hand(tmp_path: Path) -> None:
    fault = "{fault: wrench_bias, when: {node: Place, delay: 500 ms}, force: [0, 0, 8 N], lasts: 10 s}"
    found = blind(run(tmp_path, items=BLOCK, fault=fault, backend="physics"))
    assert first(found)[0] == "wrist.biased"
    (item,) = found.items
    assert "truly not in the hand any more" in [event.what for event in item.events]


def test_items_without_a_destination_are_told_as_such(tmp_path: Path) -> None:
    scene = "destinations: [{where: \"colour == 'red'\", to: red_bin}]\n"
    found = blind(run(tmp_path, scene=scene))
    assert "(the scene's rules give 1 of all items no destination)" in found.outcome.sentence


GRASPED, PLACED = (f"{line}\n" for line in MISSION.splitlines() if "Grasp:" in line or "Place:" in line)
PLACE_FIRST = MISSION.replace(GRASPED + PLACED, PLACED + GRASPED)
ELSEWHERE = MISSION.replace('into: "{item.destination}"', "at: [0.5, -0.2, 0.0]")
ASIDE = MISSION.replace(GRASPED, GRASPED.replace("Grasp", "SetAside")).replace(PLACED, "")
GREEDY = MISSION.replace("scene: scene.yaml\n", "scene: scene.yaml\ngoal: sorted >= 5\n")
CRATE = "  - {of: {crate: 1}, colours: [red], area: {min: [0.4, -0.1], max: [0.5, 0.1]}}\n"
CRATES = "catalogue: {crate: {box: [95 mm, 95 mm, 50 mm], mass: 150 g, friction: 0.6}}\n"


@pytest.mark.parametrize(
    ("options", "cause", "title", "outcome"),
    [
        ({"fault": "{fault: larger, when: {at: 0 s}, target: {kind: block}, factor: 2.2}",
          "backend": "physics"}, "item.larger", "2.2 times as large", ""),
        ({"fault": "{fault: appear, when: {at: 3 s}, kind: can, colour: red, place: [0.5, -0.2]}"},
         "item.appeared", "after the last look", ""),
        ({"mission": PLACE_FIRST}, "mission.order",
         "Place was run before anything was grasped: nothing was in the hand", ""),
        ({"items": BLOCK, "mission": ELSEWHERE}, "mission.put_elsewhere", "",
         "(the robot: 1 put down elsewhere)"),
        ({"items": BLOCK, "mission": ASIDE}, "mission.set_aside", "", ""),
        ({"mission": GREEDY}, "goal.beyond_items",
         "every item is where it belongs, and the goal is missed: `sorted >= 5` does not hold", ""),
        ({"scene": CRATES, "items": CRATE}, "item.too_wide",
         "red_crate_1 is too wide for the hand: 95 mm at its narrowest", ""),
    ],
    ids=lambda value: value if isinstance(value, str) and re.fullmatch(r"\w+\.\w+", value) else "",
)  # fmt: skip
def test_items_and_missions_at_fault(
    options: dict[str, Any], cause: str, title: str, outcome: str, tmp_path: Path
) -> None:
    found = blind(run(tmp_path, **options))
    assert found.root_causes[0].cause == cause
    assert title in found.root_causes[0].title
    assert outcome in found.outcome.sentence
    assert "item.crowded" not in {root.cause for root in found.root_causes}
    if cause == "mission.set_aside":
        assert [item.state for item in found.items] == ["aside"]


def test_a_silent_sensor_is_known_though_its_reading_turns_with_the_hand() -> None:
    times, rng = np.asarray(0.05 * np.arange(200), np.float64), np.random.default_rng(3)
    angle = np.where(times < 6.0, np.sin(times), np.sin(6.0))
    forces = 3.0 * np.column_stack([np.cos(angle), np.sin(angle), 0.1 * angle])
    assert not smooth_spans(times, forces + rng.normal(0.0, 0.1, forces.shape))
    silent = (times > 4.0) & (times < 8.0)
    noise = np.where(silent[:, None], 0.0, rng.normal(0.0, 0.1, forces.shape))
    ((start, end),) = [span for span in smooth_spans(times, forces + noise) if span[1] - span[0] > 0.3]
    assert (start, end) == (pytest.approx(4.05, abs=0.11), pytest.approx(7.85, abs=0.11))


def test_a_sensor_is_not_silent_when_the_arm_rests_between_jerks() -> None:
    times, rng = np.asarray(0.05 * np.arange(200), np.float64), np.random.default_rng(4)
    jerks = np.where(((times > 3.0) & (times < 9.0))[:, None], rng.normal(0.0, 8.0, (200, 3)), 0.0)
    assert not smooth_spans(times, jerks + rng.normal(0.0, 0.05, jerks.shape))


class FrozenCamera:
    """Replacement of a camera's `capture`: its picture stands still from a time on, its clock goes on."""

    def __init__(self, capture: Callable[[object], RgbdImage], since: float) -> None:
        self._capture, self._since = capture, since
        self._last: RgbdImage | None = None

    def __get__(self, camera: object, _: type) -> Callable[[], RgbdImage]:
        def capture() -> RgbdImage:
            image = self._capture(camera)
            if self._last is None or image.stamp < self._since:
                self._last = image
            return replace(self._last, stamp=image.stamp)

        return capture


TWICE = MISSION + MISSION[MISSION.index("      - Observe") :]


@pytest.mark.parametrize(("camera", "backend"), [(PhysicsCamera, "physics"), (KinematicCamera, "kinematic")])
def test_a_picture_that_stands_still_is_named(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    camera: type[PhysicsCamera | KinematicCamera],
    backend: Backend,
) -> None:
    monkeypatch.setattr(camera, "capture", FrozenCamera(cast("Any", camera).capture, 1.0))
    folder = run(tmp_path, mission=TWICE, backend=backend)
    cause = blind(folder).root_causes[0]
    assert (cause.cause, cause.doubtful) == ("camera.frozen", False)
    assert cause.title.startswith("the image of the camera overhead was frozen, from ")
    with Run(folder) as log:
        assert any("overhead stands still" in f.message for f in explain(log).failures) == (
            backend == "physics"
        )


def test_a_cause_is_explained_without_the_plug_in_that_registers_it(tmp_path: Path) -> None:
    (tmp_path / "wave.py").write_text(
        WAVE.replace(
            "        yield\n", '        yield\n        raise Failure(TIRED, "it has waved enough")\n'
        )
    )
    mission = MISSION.replace("kind: mission\n", "kind: mission\nplugins: [wave.py]\n").replace(
        "                - Place: ", "                - Wave\n                - Place: "
    )
    fault = "{fault: wrench_dead, when: {at: 1 s}, lasts: 2 s}"
    with forgotten():
        folder = run(tmp_path, fault=fault, mission=mission)
    (tmp_path / "wave.py").unlink()
    assert "wave.tired" not in known_causes()
    with Run(folder) as log:
        found = explain(log)
        assert {"wave.tired", "safety.stale_sensor"} <= {failure.cause for failure in found.failures}
        told = " ".join(to_text(log, found, "LOG").split())
        assert "wave.tired" in told and "it has waved enough" in told


QUARANTINE = """\
destinations:
  - {where: "mass > 0.13", to: green_bin}
  - {where: "form == 'box'", to: blue_bin}
"""


def test_what_a_rule_by_mass_takes_elsewhere_counts_alike_in_result_and_explanation(tmp_path: Path) -> None:
    """The mission takes items where the robot's belief of their mass says; one was made heavier."""
    fault = "{fault: heavier, when: {at: 0 s}, target: {kind: block}, mass: 180 g}"
    folder = run(tmp_path, items=BLOCK, scene=QUARANTINE, fault=fault)
    with Run(folder) as log:
        result, found = log.result, explain(log)
        assert result is not None
        items = result.items
        assert (items.total, items.sorted, items.misplaced, items.left) == (1, 1, 0, 0)
        (item,) = found.items
        assert (item.state, item.truth) == ("done", "truly in green_bin, where it belongs")
        told = to_text(log, found, "LOG")
    assert f"{result.sim_seconds:.1f} s simulated" in told
    assert f"simulated   {result.sim_seconds:.1f} s" in result.to_text()

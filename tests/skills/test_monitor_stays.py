"""Nothing that a mission can say moves the arm while a stop is latched, or takes the monitor away."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import SensorStamps

from .cell import Cell, items, mission

TRIES = {
    "a node that forces success": "ForceSuccess: {GoTo: {pose: observe}}",
    "one after the other": (
        "Fallback: [{GoTo: {pose: observe}}, {Jog: {velocity: [0, 0, 0.1], duration: 1 s}}]"
    ),
    "recovery without a retreat": (
        "Recover: {attempts: 3, do: {GoTo: {pose: observe}}, when: {safety.*: AlwaysSuccess}}"
    ),
    "two at once": "Parallel: {success_count: 1, do: [AlwaysSuccess, {GoTo: {pose: observe}}]}",
    "a look, then a grasp": (
        'Sequence: [{Observe: {camera: overhead, objects: "{items}"}}, '
        'ForEach: {in: "{items}", out: "{item}", do: {ForceSuccess: {Grasp: {object: "{item}"}}}}]'
    ),
    "what comes after": 'GoTo: {pose: observe, _onFailure: "tried := true", _post: "x := 1"}',
}


@pytest.mark.parametrize("body", TRIES.values(), ids=TRIES.keys())
def test_no_mission_moves_a_stopped_arm(body: str) -> None:
    cell = Cell(mission(body), items(block=1))
    for _ in range(4):
        cell.wait()
    control = cell.world.control
    control.monitor.unattended("somebody", "Track", 1.0)
    before = control.state.position.copy()
    stop = control.monitor.stopped
    cell.finish()
    assert np.abs(control.state.position - before).max() < 1e-6
    assert control.monitor.stopped is stop
    assert control.monitor.stops == 1
    cell.start(mission("SafeRetreat"))
    assert cell.finish().value == "SUCCESS"
    assert control.monitor.stopped is None


def test_no_node_has_a_port_for_it_and_a_mission_no_key() -> None:
    words = re.compile(r"monitor|safety|acknowledge|watchdog|torque_limit|payload|ignore")
    ports = {f"{node.id}.{port.key}" for node in NodeRegistry().declarations() for port in node.ports}
    assert {name for name in ports if words.search(name)} == set[str]()
    text = "picktree: 1\nkind: mission\n{}\ntrees:\n  Main: {{GoTo: {{pose: home}}}}\n"
    for key in ("limits: {force: 500 N}", "monitor: off", "safety: false"):
        with pytest.raises(PicktreeError, match="a mission has no key"):
            parse_mission(text.format(key), Path("mission.yaml"), NodeRegistry())


def test_a_skill_that_raises_ends_as_a_fault_of_the_program_with_the_arm_braked(tmp_path: Path) -> None:
    (tmp_path / "raising.py").write_text(RAISING)
    text = "picktree: 1\nkind: mission\nplugins: [raising.py]\ntrees:\n  Main: {ForceSuccess: Raising}\n"
    path = tmp_path / "mission.yaml"
    path.write_text(text)
    cell = Cell(parse_mission(text, path, NodeRegistry()), items(block=1))
    while cell.happened("internal_error") == []:
        cell.tick()
    moved = cell.world.control.tcp.position[2]
    assert cell.rest() < 1.0
    assert cell.world.control.tcp.position[2] - moved < 0.06
    assert cell.world.control.controller == "Hold"


def test_a_stop_fails_also_a_skill_that_does_not_move() -> None:
    cell = Cell(mission("GoTo: {pose: observe}"), items(block=1))
    cell.tick()
    cell.world.control.monitor.check_sensors(1.0, SensorStamps(1.0, 1.0, 0.5))
    cell.tick()
    assert cell.told == "safety.stale_sensor: the wrist sensor has given no new reading since 0.50 s"


def waiting(node: str, folder: Path) -> Cell:
    """A cell in which a skill of a plug-in has begun to wait."""
    (folder / "waiting.py").write_text(WAITING)
    text = f"picktree: 1\nkind: mission\nplugins: [waiting.py]\ntrees:\n  Main: {node}\n"
    path = folder / "mission.yaml"
    path.write_text(text)
    cell = Cell(parse_mission(text, path, NodeRegistry()), items(block=1))
    cell.tick()
    assert cell.running
    return cell


def test_a_stop_fails_a_skill_that_has_the_arm_and_only_waits(tmp_path: Path) -> None:
    cell = waiting("WaitsWithTheArm", tmp_path)
    cell.world.control.monitor.check_tool((2.0, 0.0, 0.5))
    cell.tick()
    report = cell.failure
    assert (
        cell.told
        == "safety.workspace: the tool is 1100 mm outside the workspace: x = 2000 mm, at most 900 mm"
    )
    assert report.evidence == {"position": [2.0, 0.0, 0.5], "axis": "x", "by": 1.1}


def test_a_stop_leaves_alone_what_does_not_have_the_arm_or_sees_to_stops(tmp_path: Path) -> None:
    for node in ("Waits", "SeesToStops"):
        cell = waiting(node, tmp_path)
        cell.world.control.monitor.check_tool((2.0, 0.0, 0.5))
        for _ in range(3):
            cell.tick()
            assert cell.running, node


def test_a_stop_from_before_does_not_fail_what_only_waits(tmp_path: Path) -> None:
    """Whether it may move is for its motions to find out."""
    cell = waiting("Waits", tmp_path)
    cell.world.control.monitor.check_tool((2.0, 0.0, 0.5))
    text = (tmp_path / "mission.yaml").read_text().replace("Waits", "WaitsWithTheArm")
    cell.start(parse_mission(text, tmp_path / "mission.yaml", NodeRegistry()))
    for _ in range(3):
        cell.tick()
        assert cell.running
    monitor = cell.world.control.monitor
    monitor.acknowledge("somebody")
    cell.tick()
    monitor.check_tool((3.0, 0.0, 0.5))
    cell.tick()
    assert cell.failure.message.startswith("the tool is 2100 mm outside the workspace")


WAITING = '''
from picktree.trees import ARM, Skill, Steps
from picktree.world import safety


class Waits(Skill):
    """Waits."""

    causes = (safety.ANY,)
    example = "Waits"

    def run(self, world) -> Steps:
        while True:
            yield


class WaitsWithTheArm(Waits):
    """Waits, and nobody else may move the arm."""

    uses = (ARM,)
    example = "WaitsWithTheArm"


class SeesToStops(WaitsWithTheArm):
    """Waits, whatever happens."""

    sees_to_stops = True
    example = "SeesToStops"


NODES = (Waits, WaitsWithTheArm, SeesToStops)
'''

RAISING = '''
from picktree.trees import ARM, Skill, Steps
from picktree.world import control
from picktree.robot.control import Twist


class Raising(Skill):
    """Begins to move, and raises."""

    causes = (control.ANY,)
    uses = (ARM,)
    example = "Raising"

    def run(self, world) -> Steps:
        moving = world.move.jog(Twist((0.0, 0.0, 0.3)), node=self.path, duration=5.0)
        for _ in range(12):
            next(moving)
            yield
        raise ValueError("a fault")


NODES = (Raising,)
'''

"""Any change to a scene, robot or fault file ends in a value or in a FileError, in no other exception."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.files import FileError
from picktree.simulation import parse_faults
from picktree.world.robot_model import parse_robot
from picktree.world.robot_model.robot_file import SHIPPED as ROBOTS
from picktree.world.scene import parse_scene
from picktree.world.scene.scene_loading import SHIPPED as SCENES

from ..authoring.mistakes import paths

SCENE = SCENES / "three_bins.yaml"
FED = (
    SCENE.read_text()
    + """\
feed:
  - {of: {block: 2}, colours: [red], area: {min: [0.4, -0.2], max: [0.6, 0.2]}, when: {at: [1 s, 2 s]}}
  - {of: {block: 2}, colours: [red], area: {min: [0.4, -0.2], max: [0.6, 0.2]}, when: {every: 9 s}, gap: 0.02}
  - {of: {can: 2, plate: 1}, colours: [red, blue], belt: belt, spacing: 20 cm, total: 9, lying: 0.5}
exchange: {takes: 6 s}
"""
)
BELT = "  belt: {belt: [1, 0.2, 0.05], at: [0.5, 0, 0], speed: 8 cm/s, eye: 0.3}\n"
FED = FED.replace("cameras:", f"{BELT}cameras:", 1)
ROBOT = ROBOTS / "panda.yaml"
FAULTS = """\
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {node: A/Grasp, start: 1}, target: {nearest_to: tool}}
  - {fault: bump, when: {at: 3 s}, target: {index: 2}, velocity: [0, 0, 1]}
"""

SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**30), 10**30),
    st.floats(),
    st.sampled_from(
        ["a" * 5000, "", "1 m", "-3 mm", "5 deg", "nan", "red", "a b", "/", "x.yaml", "1e400 m", "é", "\t"]
    ),
    st.text(max_size=8),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)


def changed(text: str, data: st.DataObject) -> str:
    root = yaml.safe_load(text)
    for _ in range(data.draw(st.integers(1, 3))):
        *above, last = data.draw(st.sampled_from([place for place in paths(root) if place]))
        parent = root
        for part in above:
            parent = parent[part]
        match data.draw(st.sampled_from(["replace", "remove", "add"])):
            case "remove" if isinstance(parent, dict) and len(parent) > 1:
                del parent[last]
            case "add" if isinstance(parent, dict):
                parent[data.draw(st.text(max_size=5))] = data.draw(VALUES)
            case _:
                parent[last] = data.draw(VALUES)
    return yaml.safe_dump(root, allow_unicode=True, sort_keys=False)


def test_the_scene_with_a_feed_is_one() -> None:
    assert len(parse_scene(FED, SCENE).deliveries) == 3


SOURCES: dict[Path, tuple[Callable[[str, Path], object], list[str]]] = {
    SCENE: (parse_scene, [SCENE.read_text(), FED]),
    ROBOT: (parse_robot, [ROBOT.read_text()]),
    Path("f.yaml"): (parse_faults, [FAULTS]),
}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
@settings(max_examples=30)
@given(st.data())
def test_a_changed_file_is_read_or_has_faults(path: Path, data: st.DataObject) -> None:
    parse, texts = SOURCES[path]
    try:
        parse(changed(data.draw(st.sampled_from(texts)), data), path)
    except FileError as error:
        assert all(str(fault) for fault in error.faults)

"""The sub-trees that come with picktree: without a fault or a warning, declared and documented."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.authoring import check_mission
from picktree.files.yaml import read_document
from picktree.trees import LIBRARY, library_names, path_of
from picktree.trees.loading import NodeRegistry, examine


@pytest.mark.parametrize("name", library_names())
def test_a_library_is_without_a_fault_or_a_warning(name: str) -> None:
    document = read_document(path_of(f"library/{name}", Path()), "mission")
    checked = check_mission(document)
    assert [str(fault) for fault in checked.faults] == []
    assert checked.mission is not None
    assert checked.mission.library


@pytest.mark.parametrize("name", library_names())
def test_its_ports_have_types_and_docs(name: str) -> None:
    mission = examine(read_document(LIBRARY / f"{name}.yaml", "mission"), NodeRegistry()).mission
    ports = [(tree.name, port) for tree in mission.trees.values() for port in tree.ports]
    assert [(tree, port.key) for tree, port in ports if not port.doc or str(port.type) == "any"] == []


USES = """
picktree: 1
kind: mission
scene: three_bins
include: [library/recovery, library/sorting]
trees:
  Main:
    Sequence:
      - Observe: {objects: "{items}"}
      - ForEach:
          in: "{items}"
          out: "{item}"
          do:
            Recover:
              do: {PickAndPlace: {item: "{item}", attempts: 2}}
              when:
                perception.*: LookAgain
                grasp.missed: {RetreatAndLook: {pose: observe}}
                world.disturbed: {WaitAndLook: {pause: 1 s}}
              otherwise: SafeRetreat
              give_up: {LetGoAndRetreat: {pose: home}}
      - PickAndPlaceAll: {items: "{items}", camera: overhead}
"""


def test_its_trees_can_be_used_as_they_are_meant() -> None:
    checked = check_mission(read_document(Path("mission.yaml"), "mission", USES))
    assert [str(fault) for fault in checked.faults if fault.severity == "error"] == []
    text = USES.replace("pause: 1 s", "pause: 1 m").replace("pose: observe", "pose: observed")
    wrong = check_mission(read_document(Path("mission.yaml"), "mission", text)).faults
    assert [(fault.where, fault.message) for fault in wrong if fault.severity == "error"] == [
        (
            "Main/Sequence/ForEach/Recover/RetreatAndLook",
            "port 'pose': the robot 'panda' has no pose 'observed'",
        ),
        (
            "Main/Sequence/ForEach/Recover/WaitAndLook",
            "port 'pause': '1 m' is a length, not a time (as 500 ms)",
        ),
    ]

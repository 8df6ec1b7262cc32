"""Out and in again: nothing is lost, and BehaviorTree.CPP takes what is written."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings

from picktree.authoring.xml import mission_to_xml
from picktree.files.yaml import read_document
from picktree.trees import LIBRARY
from picktree.trees.loading import NodeRegistry, examine

from ..trees.scripted import FILE
from .btcpp_rules import complaints
from .xml_missions import essence, missions, parsed, registry, xml_to_mission

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = [
    path
    for path in sorted((*EXAMPLES.glob("*.yaml"), *LIBRARY.glob("*.yaml")))
    if "\nkind: mission\n" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_examples_and_library_survive(path: Path) -> None:
    known = NodeRegistry()
    first = examine(read_document(path, "mission"), known)
    assert first.faults == ()
    xml = mission_to_xml(first.mission)
    text = xml_to_mission(xml, path.with_suffix(".xml"), known)
    second = examine(read_document(path, "mission", text), known)
    assert second.faults == ()
    assert essence(second.mission) == essence(first.mission)
    assert mission_to_xml(second.mission) == xml
    assert complaints(xml) == []


@given(missions())
@settings(max_examples=20)
def test_any_mission_survives(text: str) -> None:
    first = parsed(text)
    xml = mission_to_xml(first)
    assert complaints(xml) == []
    second = parsed(xml_to_mission(xml, FILE.with_suffix(".xml"), registry()))
    assert essence(second) == essence(first)
    assert mission_to_xml(second) == xml


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ("<root/>", "no <root> of format 4"),
        ('<root BTCPP_format="4"><BehaviorTree ID="a b"><AlwaysSuccess/></BehaviorTree></root>',
         "tree: 'a b' is no name"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><Inverter/></BehaviorTree></root>',
         "Inverter must have exactly 1 child"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><Grasp/></BehaviorTree></root>',
         "Node not recognized: Grasp"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><AlwaysSuccess x="1"/></BehaviorTree></root>',
         "a port with name [x] is found in <AlwaysSuccess>"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><AlwaysSuccess _skipIf="a.b"/></BehaviorTree></root>',
         "Error in the script 'a.b'"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><Timeout msec="0.5"><AlwaysSuccess/></Timeout>'
         "</BehaviorTree></root>", "[msec] with value [0.5] can not be converted to unsigned"),
        ('<root BTCPP_format="4"><BehaviorTree ID="Main"><SubTree ID="B" t="600"/></BehaviorTree>'
         '<BehaviorTree ID="B"><Delay delay_msec="{t}"><AlwaysSuccess/></Delay></BehaviorTree></root>',
         "[t] is int, and later unsigned"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><SubTree ID="B"/></BehaviorTree></root>',
         "Can't find a tree with name: B"),
    ],
)  # fmt: skip
def test_the_rules_of_btcpp_can_be_broken(wrong: str, complaint: str) -> None:
    assert complaint in complaints(wrong)


COMMENTED = """# head
picktree: 1
# about the kind
kind: mission
trees:
  # above Main
  Main:
    Sequence:
      - Fallback:
          - AlwaysSuccess
          # last of Fallback
      # between
      - AlwaysFailure
      # last of Sequence
    # last of Main

  # above Sub
  Sub:
    doc: what it does
    Sequence:
      - AlwaysSuccess
      # last of Sub
  # below Sub
# end
"""


def test_a_truth_value_decides_between_numbers() -> None:
    mission = parsed(
        "picktree: 1\nkind: mission\ntrees:\n  Main:\n    Sequence:\n"
        '      - Script: {code: "n := 3; full := n > 2"}\n'
        '      - Switch: {variable: "{full}", cases: {"true": AlwaysSuccess, "false": AlwaysFailure}}\n'
    )
    xml = mission_to_xml(mission)
    assert '<Switch2 variable="{full}" case_1="1" case_2="0">' in xml
    assert essence(parsed(xml_to_mission(xml, FILE.with_suffix(".xml"), registry()))) == essence(mission)


def test_comments_and_descriptions_go_out_and_come_in() -> None:
    mission = parsed(COMMENTED)
    text = xml_to_mission(mission_to_xml(mission), FILE.with_suffix(".xml"), registry())
    above = COMMENTED.replace("# about the kind\n", "").replace("# head\n", "# head\n# about the kind\n")
    assert text == above.replace("  # below Sub", "# below Sub")
    again = parsed(text)
    assert xml_to_mission(mission_to_xml(again), FILE.with_suffix(".xml"), registry()) == text

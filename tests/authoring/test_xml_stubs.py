"""Stubs of unknown nodes: what is known of them, the plug-in's text, and the mission that names it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from picktree.authoring.xml import ImportOptions, XmlText, convert_all, read_files
from picktree.authoring.xml.source import ImportFaults, read_source
from picktree.authoring.xml.stubs import StubFinder, stub_class
from picktree.files import FileError, PicktreeError
from picktree.trees import Node
from picktree.trees.loading import NodeRegistry, load_mission, load_plugin

XML = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence>
      <Condition ID="Is it there" area="left;right"/>
      <ComputePose pose="{pose}" tolerance="0.5"/>
      <Keep alive="true" _skipIf="false"><MoveIt goal="{pose}" in="3" speed="fast"/></Keep>
      <MoveIt goal="{pose}" in="4"/>
      <Race><OpenGripper torque="1.0"/><None/></Race>
      <Log message="at" value="{pose}"/>
    </Sequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Condition ID="Is it there"><input_port name="area" type="std::vector&lt;std::string&gt;"/></Condition>
    <Action ID="MoveIt">
      <input_port name="goal" type="geometry_msgs::msg::Pose">where "it" goes \\</input_port>
      <input_port name="speed" type="std::string" default="slow"/>
      <input_port name="frame" default="{=}"/>
    </Action>
    <Action ID="OpenGripper"><input_port name="torque" type="double"/></Action>
  </TreeNodesModel>
</root>
"""
KNOWN = """Is_it_there condition in area: list of string
ComputePose action out pose: any, in tolerance: float
Keep decorator in alive: bool
MoveIt action in goal: any, in speed: string = slow, in frame: any, in in: int
Race control
OwnOpenGripper action in torque: float
None action"""


def described(nodes: Sequence[type[Node]]) -> str:
    lines: list[str] = []
    for node in nodes:
        ports = [
            f"{p.direction} {p.key}: {p.type}"
            + ("" if p.required or p.direction == "out" else f" = {p.default}")
            for p in node.declaration.ports
        ]
        lines.append(f"{node.declaration.id} {node.declaration.kind} {', '.join(ports)}".rstrip())
    return "\n".join(lines)


def test_what_the_model_and_the_uses_say_of_a_node() -> None:
    faults = ImportFaults()
    source = read_source([XmlText(XML, Path("tree.xml"))], faults)
    stubs, _ = StubFinder(source, NodeRegistry(), faults, {}).find()
    known = described([stub_class(stub) for stub in stubs.values()])
    assert known.replace("in frame: any = None", "in frame: any") == KNOWN


def test_the_plug_in_declares_the_same_nodes_and_the_mission_loads_with_it(tmp_path: Path) -> None:
    (tmp_path / "tree.xml").write_text(XML)
    files = read_files([tmp_path / "tree.xml"])
    found = convert_all(files, ImportOptions(stubs="nodes.py"))
    (tmp_path / "nodes.py").write_text(found.stubs)
    (tmp_path / "mission.yaml").write_text(found.text)
    plugin = load_plugin("nodes.py", tmp_path)
    assert described(plugin.nodes).replace("in frame: any = None", "in frame: any") == KNOWN
    mission = load_mission(tmp_path / "mission.yaml")
    assert [spec.id for spec in mission.trees["Main"].root.children][:2] == ["Is_it_there", "ComputePose"]
    # The next conversion uses what is there.
    again = convert_all(files, ImportOptions(plugins=("nodes.py",), folder=tmp_path))
    assert again.stubs == ""


def test_without_stubs_one_fault_names_all_unknown_nodes() -> None:
    with pytest.raises(FileError) as caught:
        convert_all([XmlText(XML, Path("tree.xml"))], ImportOptions())
    [fault] = [fault for fault in caught.value.faults if fault.severity == "error"]
    assert fault.code == "P906" and fault.message == "7 nodes are unknown"
    assert fault.detail.splitlines()[3] == "MoveIt: Action, line 6 and 1 more"


@pytest.mark.parametrize("text", ['"""', "\\", '\\"""\nimport os', "'", "\u2028x", "\U0001f916\x85", "a\tb"])
def test_no_text_of_the_model_gets_out_of_its_quotes(text: str, tmp_path: Path) -> None:
    given = quoteattr(text)
    xml = (
        f'<root BTCPP_format="4"><BehaviorTree ID="Main"><Evil a={given}/></BehaviorTree><TreeNodesModel>'
        f'<Action ID="Evil"><input_port name="a" type="std::string" default={given} description={given}/>'
        f'<input_port name={quoteattr("p" + text)} default="1"/></Action></TreeNodesModel></root>'
    )
    found = convert_all([XmlText(xml, tmp_path / "tree.xml")], ImportOptions(stubs="nodes.py"))
    (tmp_path / "nodes.py").write_text(found.stubs, encoding="utf-8")
    [node] = load_plugin("nodes.py", tmp_path).nodes
    assert node.declaration.ports[0].default == text


def test_a_folder_is_read_whole_and_what_the_first_tree_does_not_use_is_left_out(tmp_path: Path) -> None:
    for name, inside in {"a": '<SubTree ID="b"/>', "b": "<AlwaysSuccess/>", "c": "<Unknown/>"}.items():
        (tmp_path / f"{name}.xml").write_text(
            f'<root BTCPP_format="4" main_tree_to_execute="{name}"><BehaviorTree ID="{name}">{inside}'
            "</BehaviorTree></root>"
        )
    (tmp_path / "package.xml").write_text("<package/>")
    found = convert_all(read_files([tmp_path]), ImportOptions(main="a"))
    assert found.text == "picktree: 1\nkind: mission\ntrees:\n  Main: b\n\n  b: AlwaysSuccess\n"
    with pytest.raises(FileError) as caught:
        convert_all(read_files([tmp_path]), ImportOptions())
    assert "which of the 3 trees is the first one?" in str(caught.value)
    (tmp_path / "none").mkdir()
    with pytest.raises(PicktreeError, match="there is no XML file with trees"):
        read_files([tmp_path / "none"])


def test_a_tree_that_no_file_has_is_a_node() -> None:
    xml = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><SubTree ID="Look around" to="{pose}" '
        '_autoremap="true"/><Log message="at" value="{pose}"/></Sequence></BehaviorTree></root>'
    )
    found = convert_all([XmlText(xml, Path("tree.xml"))], ImportOptions(stubs="nodes.py"))
    assert '- Look_around: {to: "{pose}"}' in found.text
    assert "to: Out[object]" in found.stubs
    assert found.notes[0].message == "there is no tree 'Look around'; the name is taken for a node"


def test_texts_that_a_node_fills_in_and_nodes_that_only_share_a_name(tmp_path: Path) -> None:
    xml = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><Script code="x := 1"/>'
        '<Tell what="at {x} of {y}"/><Tell what="5"/><Place item="a"/><Log message="so"/></Sequence>'
        "</BehaviorTree></root>"
    )
    (tmp_path / "tree.xml").write_text(xml)
    files = read_files([tmp_path / "tree.xml"])
    found = convert_all(files, ImportOptions(stubs="nodes.py"))
    assert found.text.endswith(
        '      - Script: {code: "x := 1"}\n      - Tell: {what: "at {x} of {y}"}\n      - Tell: {what: "5"}\n'
        "      - OwnPlace: {item: a}\n      - Log: {message: so}\n"
    )
    assert 'what: In[str] = port("what of Tell", takes="template")' in found.stubs
    (tmp_path / "nodes.py").write_text(found.stubs)
    (tmp_path / "mission.yaml").write_text(found.text)
    assert load_mission(tmp_path / "mission.yaml").trees["Main"].root.children[3].id == "OwnPlace"
    # Without stubs a port too many is a mistake.
    with pytest.raises(FileError) as caught:
        convert_all(files, ImportOptions())
    assert "P908" in [fault.code for fault in caught.value.faults]


def test_directions_follow_from_names_and_from_the_order_of_the_sub_trees() -> None:
    xml = (
        '<root BTCPP_format="4" main_tree_to_execute="A"><BehaviorTree ID="A"><Sequence>'
        '<IsThere what="{o}"/><SubTree ID="See" pose="{p}"/><Turn input_pose="{p}" output_pose="{p}"/>'
        '<Drive to="{p}"/></Sequence>'
        '</BehaviorTree><BehaviorTree ID="See"><Look at="{pose}"/></BehaviorTree></root>'
    )
    stubs = convert_all([XmlText(xml, Path("tree.xml"))], ImportOptions(stubs="nodes.py")).stubs
    lines = [line.strip().partition(" = ")[0] for line in stubs.splitlines() if ": Out[" in line]
    assert sorted(lines) == ["at: Out[object]", "output_pose: Out[object]"]
    assert "class IsThere(ConditionNode)" in stubs

"""Trees as others write them: what the import makes of them, and what it says; BehaviorTree.CPP beside it.

The cases are in `foreign_trees.md`: `same` comes in without a word, `noted` with notes, `refused` not at all.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from picktree.authoring import check_mission
from picktree.authoring.xml import ImportOptions, XmlText, check_xml, convert_all, mission_to_xml
from picktree.authoring.xml.mission_import import ImportedMission, import_xml
from picktree.files import FileError
from picktree.files.yaml import read_document
from picktree.trees.loading import NodeRegistry

from .btcpp_library import LIBRARY
from .foreign_library import Library, comparable
from .xml_missions import parsed, registry

HERE = Path("tree.xml")
_CASE = re.compile(
    r"^## (?P<kind>\w+): (?P<name>[^\n]+)\n\n```xml\n(?P<xml>.*?)\n```\n"
    r"(?:\n```yaml\n(?P<trees>.*?)\n```\n)?(?:\n```text\n(?P<said>.*?)\n```\n)?",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Case:
    """A file, the trees that it becomes, and what is said about it."""

    kind: str
    xml: str
    trees: str
    said: list[str]


CASES = {
    match["name"]: Case(
        match["kind"], match["xml"], f"{match['trees'] or ''}\n", (match["said"] or "").splitlines()
    )
    for match in _CASE.finditer((Path(__file__).parent / "foreign_trees.md").read_text(encoding="utf-8"))
}


def of(*kinds: str) -> list[str]:
    return [name for name, case in CASES.items() if case.kind in kinds]


def imported(xml: str, options: ImportOptions | None = None) -> ImportedMission:
    return import_xml([XmlText(xml, HERE)], registry(), options)


def faults_of(xml: str, options: ImportOptions | None = None) -> list[str]:
    with pytest.raises(FileError) as caught:
        imported(xml, options)
    return [f"{each.code} {each}".replace("tree.xml:", "") for each in caught.value.faults]


def test_all_cases_are_read() -> None:
    text = (Path(__file__).parent / "foreign_trees.md").read_text(encoding="utf-8")
    assert len(CASES) == text.count("\n## ")
    assert {case.kind for case in CASES.values()} == {"same", "noted", "refused"}


@pytest.mark.parametrize("name", of("same", "noted"))
def test_what_comes_in(name: str) -> None:
    case, found = CASES[name], imported(CASES[name].xml)
    assert found.text.partition("trees:\n")[2] == case.trees
    assert [f"{note.code} {note}".replace("tree.xml:", "") for note in found.notes] == case.said
    assert (case.kind == "same") == (case.said == [])


@pytest.mark.parametrize("name", of("refused"))
def test_what_would_mean_something_else_is_refused(name: str) -> None:
    assert faults_of(CASES[name].xml) == CASES[name].said


@pytest.mark.parametrize("name", [name for name in of("noted") if name != "a port that no node uses"])
def test_strict_refuses_what_is_only_noted_otherwise(name: str) -> None:
    assert faults_of(CASES[name].xml, ImportOptions(strict=True)) != []


def test_names_of_numbers() -> None:
    xml = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><Script code="c := RED"/>'
        '<AlwaysSuccess _skipIf="c != RED"/></Sequence></BehaviorTree></root>'
    )
    found = imported(xml, ImportOptions(enums={"RED": 2}))
    assert found.text.endswith(
        '  Main:\n    Sequence:\n      - Script: {code: "c := 2"}\n      - AlwaysSuccess: {_skipIf: c != 2}\n'
    )


def test_comments_come_out_where_they_came_in() -> None:
    xml = CASES["comments above the only child"].xml
    again = mission_to_xml(parsed(imported(xml).text))
    trees = again.partition("main_tree_to_execute")[2].partition("  <TreeNodesModel>")[0]
    assert trees == xml.partition("main_tree_to_execute")[2].removesuffix("</root>")


def test_comments_above_slots_belong_to_what_stands_in_them() -> None:
    mission = """
picktree: 1
kind: mission
trees:
  Main:
    Switch:
      variable: red
      # all
      cases:
        # one
        red:
          # inverted
          Inverter: AlwaysSuccess
      # else
      default:
        Inverter: AlwaysSuccess
"""
    lines = [line.strip() for line in mission_to_xml(parsed(mission)).splitlines()]
    assert lines[3:13] == [
        '<Switch1 variable="red" case_1="red">',
        "<!-- all -->",
        "<!-- one -->",
        "<!-- inverted -->",
        "<Inverter>",
        "<AlwaysSuccess/>",
        "</Inverter>",
        "<!-- else -->",
        "<Inverter>",
        "<AlwaysSuccess/>",
    ]


def test_joined_texts_go_out_as_joined_texts() -> None:
    text = "  Main:\n    Sequence:\n      - Script: {code: \"i := 2; label := 'box_' + i\"}\n"
    text += '      - Log: {message: x, value: "{label}"}\n'
    whole = f"picktree: 1\nkind: mission\ntrees:\n{text}"
    assert "<Script code=\"i := 2; label := 'box_' .. i\"/>" in mission_to_xml(parsed(whole))
    document = read_document(Path("m.yaml"), "mission", whole)
    assert check_mission(document, NodeRegistry()).faults == ()


TWO = (
    '<root BTCPP_format="4"><BehaviorTree ID="Sort"><SubTree ID="Open"/></BehaviorTree>'
    '<BehaviorTree ID="Open"><OpenGripper/></BehaviorTree></root>'
)


def test_the_first_tree_is_named_where_no_file_does() -> None:
    with pytest.raises(FileError) as caught:
        convert_all([XmlText(TWO, HERE)], ImportOptions())
    assert [fault.code for fault in caught.value.faults] == ["P914"]
    found = convert_all([XmlText(TWO, HERE)], ImportOptions(main="Sort"))
    assert found.text.endswith("trees:\n  Main: Open\n\n  Open: OpenGripper\n")
    with pytest.raises(FileError, match="there is no tree 'Sorted'"):
        convert_all([XmlText(TWO, HERE)], ImportOptions(main="Sorted"))


def test_a_plug_in_that_cannot_be_imported_shows_its_own_fault(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("class Broken(Skill)\n    pass\n")
    xml = (
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Broken/></BehaviorTree>'
        '<TreeNodesModel><SubTree ID="Main"><MetadataFields><Metadata plugins="broken.py"/></MetadataFields>'
        "</SubTree></TreeNodesModel></root>"
    )
    with pytest.raises(FileError) as caught:
        convert_all([XmlText(xml, tmp_path / "tree.xml")], ImportOptions())
    (fault,) = caught.value.faults
    assert fault.code == "P252" and "SyntaxError: expected ':'" in fault.message
    assert [each.code for each in check_xml(xml, tmp_path / "tree.xml")] == ["P252"]


FAILING = (
    "names of keys",  # a blank in a key is refused
    "a port that one call leaves out",
    "a literal at a port that the tree only writes",  # it has another type
    "a key of the program, and an enum",
    "keys of a tree that no other calls",
    "a key that the program makes, and the tree writes",
)
"""Cases in which BehaviorTree.CPP fails, for what the program that runs the tree would have to give it."""


@pytest.mark.parametrize("name", of("same", "noted"))
def test_the_library_ticks_them_before_and_after_alike(name: str, tmp_path: Path) -> None:
    LIBRARY.require()
    case = CASES[name]
    xml = mission_to_xml(parsed(imported(case.xml).text))
    with Library(tmp_path) as library:
        first = "A" if name == "two claims to Main" else "Main"
        refused, before = library.refuses([XmlText(case.xml, HERE)], first), library.ticks(1)
        assert library.refuses_ours(xml) == ""
        if refused or before[-1] == "threw:":
            assert name in FAILING
        elif comparable(xml, [case.xml]):
            assert library.ticks(1) == before

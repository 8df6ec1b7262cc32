"""Trees of others that once came in wrongly, and BehaviorTree.CPP beside them."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.authoring import check_mission
from picktree.authoring.xml import ImportOptions, XmlText, check_xml, convert_all, mission_to_xml
from picktree.files import FileError
from picktree.files.yaml import read_document
from picktree.trees.loading import NodeRegistry

from .btcpp_library import LIBRARY
from .foreign_library import Library, comparable
from .test_xml_foreign import CASES, HERE, imported, of
from .xml_missions import parsed

HEAD = "picktree: 1\nkind: mission\n"


def exported(trees: str) -> list[str]:
    """Return the lines of the XML up to the model, without their indents."""
    xml = mission_to_xml(parsed(f"{HEAD}trees:\n{trees}"))
    return [line.strip() for line in xml.partition("<TreeNodesModel>")[0].splitlines()]


def test_joined_texts_go_out_as_joined_texts() -> None:
    text = "  Main:\n    Sequence:\n      - Script: {code: \"i := 2; label := 'box_' + i\"}\n"
    text += '      - Log: {message: x, value: "{label}"}\n'
    assert "<Script code=\"i := 2; label := 'box_' .. i\"/>" in exported(text)
    document = read_document(Path("m.yaml"), "mission", f"{HEAD}trees:\n{text}")
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

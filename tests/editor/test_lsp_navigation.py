"""`picktree lsp`: first words of a file, hover of nodes, outline, references, definitions, pages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.cli import answer
from picktree.authoring.editor.completion import SKELETONS

from .language_server import LanguageServer
from .test_lsp import MAIN, Editor

ROOT = Path(__file__).parents[2]


@pytest.fixture
def editor(ours: LanguageServer, tmp_path: Path) -> Editor:
    return Editor(ours, tmp_path)


PLUGIN = """\
from picktree.trees import Skill


class Wave(Skill):
    \"\"\"Wave the hand.\"\"\"

    def run(self, world):
        yield


NODES = (Wave,)
"""

# First words of a file.


@pytest.mark.parametrize("text", ["|", "# a comment\n|", "pick|", "# a comment\n\nm|"])
def test_an_empty_file_is_offered_a_skeleton_of_each_kind(editor: Editor, text: str) -> None:
    offered = editor.complete(text)
    assert list(offered) == [f"picktree {kind}" for kind in SKELETONS]
    written = offered["picktree mission"].text
    assert written.endswith("$0")
    assert re.sub(r"\\(.)", r"\1", written.removesuffix("$0")) == SKELETONS["mission"]


@pytest.mark.parametrize("kind", SKELETONS)
def test_a_skeleton_is_a_file_without_faults(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "cases"
    folder.mkdir()
    for file in (tmp_path / "mission.yaml", folder / "mission.yaml"):
        file.write_text(SKELETONS["mission"], encoding="utf-8")
    (folder / "file.yaml").write_text(SKELETONS[kind], encoding="utf-8")
    monkeypatch.chdir(folder)
    assert answer(["check", "file.yaml"]) == 0
    assert capsys.readouterr().out == "1 file, no errors or warnings\n"


@pytest.mark.parametrize(
    ("text", "offered"),
    [
        ("picktree: 1\n|", {"kind"}),
        ("picktree: 1\nk|", {"kind"}),
        ("picktree: 1\nkind: |", {"mission", "scene", "robot", "faults", "cases", "plan"}),
        (
            "picktree: 1\nkind: mission\n|",
            {"name", "scene", "goal", "library", "include", "plugins", "trees"},
        ),
        (
            "kind: mission\n|\n",
            {"picktree", "name", "scene", "goal", "library", "include", "plugins", "trees"},
        ),
        ("services:\n  web: {image: x}\n|", set[str]()),
        ("a\nb|", set[str]()),
    ],
)
def test_a_file_begins_with_its_format_and_kind(editor: Editor, text: str, offered: set[str]) -> None:
    assert set(editor.complete(text)) == offered


# Hover.


def test_hover_of_a_node_has_its_ports(editor: Editor) -> None:
    for text in ("      - Gra|sp: {object: x}\n", "      - {Gra|sp: {object: x}}\n"):
        said = editor.hover(MAIN + text)
        assert said.startswith("Grasp an object between the fingers")
        ports = [line for line in said.splitlines() if line.startswith("- `")]
        assert ports[0] == "- `object`: the object to grasp *id of an object; required*"
        assert ports[1].startswith("- `force`: maximum grip force of each finger")
        assert ports[1].endswith("default: 70 N*")
        assert not any("_skipIf" in line for line in ports)
    sub_tree = (
        MAIN + "      - Pi|ck: {item: x}\n  Pick: {ports: {item: object}, do: {Grasp: {object: '{item}'}}}\n"
    )
    assert "- `item`: *id of an object; required*" in editor.hover(sub_tree)


# Outline.


def names(symbols: list[dict[str, Any]]) -> list[Any]:
    return [[each["name"], *names(each["children"])] for each in symbols]


def outline(editor: Editor, text: str) -> list[dict[str, Any]]:
    editor.at(text + "|")
    return editor.server.request("textDocument/documentSymbol", editor.path)


def test_the_outline_of_a_mission_has_trees_and_nodes(editor: Editor) -> None:
    text = MAIN + (
        "      - SafeRetreat\n"
        "      - Recover:\n"
        "          do: {Grasp: {object: x, force: 20 N}}\n"
        "          when: {grasp.missed: [SafeRetreat]}\n"
        "      - Pick\n"
        "  Pick: AlwaysSuccess\n"
    )
    found = outline(editor, text)
    assert names(found) == [
        ["picktree"],
        ["kind"],
        ["scene"],
        ["include"],
        [
            "trees",
            [
                "Main",
                ["Sequence", ["Observe"], ["SafeRetreat"], ["Recover", ["Grasp"], ["SafeRetreat"]], ["Pick"]],
            ],
            ["Pick", ["AlwaysSuccess"]],
        ],
    ]
    assert found[2]["detail"] == "three_bins"
    main, pick = found[4]["children"]
    (sequence,) = main["children"]
    assert sequence["children"][2]["children"][0]["detail"] == "object: x, force: 20 N"
    assert main["range"] == {"start": {"line": 5, "character": 2}, "end": {"line": 12, "character": 12}}
    assert main["selectionRange"]["end"] == {"line": 5, "character": 6}
    assert pick["range"]["end"] == {"line": 13, "character": 21}


def test_the_outline_of_other_files_has_their_keys(editor: Editor) -> None:
    found = outline(
        editor,
        "picktree: 1\nkind: scene\nfixtures:\n  table: {box: [1, 1, 1]}\n  wall:\n    box: [1, 1, 1]\n",
    )
    assert names(found) == [["picktree"], ["kind"], ["fixtures", ["table"], ["wall"]]]
    assert outline(editor, "services: {web: {image: x}}\n") == []


# References.


def references(editor: Editor, text: str, *, declaration: bool = False) -> list[tuple[str, int, int]]:
    at = editor.at(text)
    found = editor.server.ask(
        "textDocument/references", editor.path, *at, context={"includeDeclaration": declaration}
    )
    folder = editor.path.parent.as_uri()  # files of other tests are open, too
    starts = [
        (each["uri"].rpartition("/")[2], each["range"]["start"])
        for each in found
        if each["uri"].startswith(folder)
    ]
    return [(name, start["line"] + 1, start["character"] + 1) for name, start in starts]


CALLS = MAIN + "      - Pick\n      - {Sequence: [Pick, {Log: {message: Pick}}]}\n  Pi|ck: AlwaysSuccess\n"


def test_references_of_a_sub_tree_are_its_calls(editor: Editor) -> None:
    calls = [("m.yaml", 9, 9), ("m.yaml", 10, 21)]
    assert references(editor, CALLS) == calls
    assert references(editor, CALLS, declaration=True) == [*calls, ("m.yaml", 11, 3)]
    from_a_call = CALLS.replace("|", "").replace("- Pick", "- Pi|ck", 1)
    assert references(editor, from_a_call) == calls


def test_references_of_a_key_and_of_a_node(editor: Editor) -> None:
    text = (
        MAIN + '      - Grasp: {object: "{ite|ms}"}\n      - Grasp: {object: x, _skipIf: count(items) > 1}\n'
    )
    assert references(editor, text) == [("m.yaml", 8, 30), ("m.yaml", 9, 27), ("m.yaml", 10, 43)]
    node = text.replace("|", "").replace("Grasp", "Gra|sp", 1)
    assert references(editor, node) == [("m.yaml", 9, 9), ("m.yaml", 10, 9)]
    assert references(editor, MAIN.replace("three", "thr|ee")) == []


def test_references_of_a_sub_tree_in_missions_that_include_it(editor: Editor, tmp_path: Path) -> None:
    head = "picktree: 1\nkind: mission\n"
    (tmp_path / "uses.yaml").write_text(f"{head}scene: pile\ninclude: [m.yaml]\ntrees:\n  Main: Pick\n")
    (tmp_path / "own.yaml").write_text(f"{head}scene: pile\ntrees:\n  Main: Pick\n  Pick: AlwaysSuccess\n")
    (tmp_path / "other.yaml").write_text("Pick: 1\n")
    library = f"{head}library: true\ntrees:\n  Pi|ck: AlwaysSuccess\n"
    assert references(editor, library) == [("uses.yaml", 6, 9)]


# Definition.


@pytest.mark.parametrize(
    ("text", "file"),
    [
        ("kind: mission\nscene: three_b|ins\n", "three_bins.yaml"),
        ("kind: mission\nscene: ta|ble.yaml\n", "table.yaml"),
        ("kind: mission\nplugins: [wa|ve.py]\n", "wave.py"),
        ("kind: scene\nbase: three_b|ins\n", "three_bins.yaml"),
        ("kind: scene\nrobot: pa|nda\n", "panda.yaml"),
        ("kind: faults\nscene: ta|ble\n", "table.yaml"),
        ("kind: cases\nmission: ta|ble.yaml\n", "table.yaml"),
        ("kind: plan\nmissions: [a.yaml, ta|ble.yaml]\n", "table.yaml"),
        ("kind: plan\nfaults: [none, ta|ble.yaml]\n", "table.yaml"),
        ("kind: mission\nscene: no|ne\n", None),
        ("kind: mission\nsce|ne: three_bins\n", None),
        ("kind: plan\nfaults: [no|ne]\n", None),
    ],
)
def test_definition_of_a_named_file(editor: Editor, tmp_path: Path, text: str, file: str | None) -> None:
    (tmp_path / "table.yaml").touch()
    (tmp_path / "wave.py").write_text(PLUGIN)
    found = editor.definition(f"picktree: 1\n{text}")
    assert found == (None if file is None else (file, 1, 1))


def test_definition_of_a_node_is_its_class(editor: Editor, tmp_path: Path) -> None:
    (tmp_path / "wave.py").write_text(PLUGIN)
    text = MAIN.replace("include: [library/recovery]", "plugins: [wave.py]")
    assert editor.definition(text + "      - Wa|ve\n") == ("wave.py", 4, 7)
    assert editor.definition(text + "      - {Wa|ve: {name: x}}\n") == ("wave.py", 4, 7)
    found = editor.definition(text + "      - Safe|Retreat\n")
    assert found is not None and found[0] == "safe_retreat.py"


# Pages of faults.


def test_a_fault_links_to_its_page(editor: Editor) -> None:
    (fault,) = editor.check(MAIN + "      - Graps: {object: x}\n")
    href = fault["codeDescription"]["href"]
    assert href == (ROOT / "files/pages/P207.md").as_uri()

"""Answers to an author in an editor: the real yaml-language-server, driven as editors drive it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.authoring.schema import mission_schema, one_mission, to_text
from picktree.files.yaml import read_document
from picktree.trees.loading import NodeRegistry

from .language_server import Diagnostic, LanguageServer, Proposal

ROOT = Path(__file__).parents[2]
SHIPPED = sorted(
    file
    for pattern in (
        "examples/**/*.yaml",
        "trees/library/*.yaml",
        "world/scenes/*.yaml",
        "world/robots/*.yaml",
    )
    for file in ROOT.glob(pattern)
    if "templates" not in file.parts  # `picktree new` writes their schemas beside them
)
MISSION = """\
picktree: 1
kind: mission
scene: three_bins
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
"""
SCENE = """\
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02], colour: light_grey}
cameras:
  overhead: {at: [0.5, 0, 0.8], look_at: [0.5, 0, 0], fov: 60 deg}
"""
_numbers = itertools.count()


class Editor:
    """A window with one file in it; `|` in a text is where the cursor stands.

    The line that names the schema stands above and is not counted.
    """

    def __init__(self, server: LanguageServer, folder: Path, schema: Path) -> None:
        self._server, self._folder, self._schema = server, folder, schema

    def squiggles(self, text: str) -> list[Diagnostic]:
        path = self._path()
        found = self._server.diagnostics({path: self._whole(text)})[path]
        return [replace(diagnostic, line=diagnostic.line - 1) for diagnostic in found]

    def proposals(self, text: str) -> dict[str, Proposal]:
        path, line, column = self._open(text)
        return self._server.complete(path, line, column)

    def hover(self, text: str) -> str:
        path, line, column = self._open(text)
        return self._server.hover(path, line, column).partition("\n\nSource:")[0]

    def _open(self, text: str) -> tuple[Path, int, int]:
        before, _, after = self._whole(text).partition("|")
        path = self._path()
        self._server.open(path, before + after)
        return path, before.count("\n") + 1, len(before) - before.rfind("\n")

    def _path(self) -> Path:
        return self._folder / f"{next(_numbers)}.yaml"

    def _whole(self, text: str) -> str:
        return f"# yaml-language-server: $schema={self._schema}\n{text}"


@pytest.fixture
def mission(server: LanguageServer, tmp_path: Path) -> Editor:
    return Editor(server, tmp_path, ROOT / "schemas/mission.json")


@pytest.fixture
def scene(server: LanguageServer, tmp_path: Path) -> Editor:
    return Editor(server, tmp_path, ROOT / "schemas/scene.json")


# Squiggles.


def test_nothing_is_underlined_in_what_we_ship(server: LanguageServer) -> None:
    files = {file: file.read_text(encoding="utf-8") for file in SHIPPED}
    assert len(files) > 15
    assert server.diagnostics(files) == {file: [] for file in SHIPPED}


def test_what_we_ship_is_looked_at_by_its_own_line_that_names_a_schema(server: LanguageServer) -> None:
    files = {file: file.read_text(encoding="utf-8") + "nonsense: 1\n" for file in SHIPPED}
    found = server.diagnostics(files)
    assert {file: [d.message for d in found[file]] for file in SHIPPED} == {
        file: ["Property nonsense is not allowed."] for file in SHIPPED
    }


@pytest.mark.parametrize(
    ("node", "column", "message"),
    [
        ("- Observe: {camra: overhead}", 19, "Property camra is not allowed."),
        ("- GoTo: {speed: fast}", 23, 'a number, or a share, as "50 %", or a reference'),
        ("- Delay: {delay_msec: 5 N, do: GoTo}", 29, 'a number in ms, or as "2 s", or a reference'),
        ("- GoTo: {speed: 1.5}", 23, "Value is above the maximum of 1."),
        ("- Grasp: {force: 20 N}", 9, 'Missing property "object".'),
        ("- Grasp", 9, "a node of this name needs ports or children"),
        (
            "- SafeRetreat: {hand: opn}",
            29,
            'Value is not accepted. Valid values: "keep", "open", "put_down".',
        ),
        ("- Observe: {objects: items}", 28, 'an output needs a key to write to, as "{key}"'),
        ("- Timeout: {msce: 5 s, msec: 5 s, do: GoTo}", 19, "Timeout has no such port"),
        ("- Timeout: {msec: 5 s}", 9, 'Missing property "do".'),
        ("- IfThenElse: [GoTo]", 21, "Array has too few items. Expected 2 or more."),
        (
            "- Recover: {do: GoTo, when: {grasp.mised: GoTo}}",
            36,
            "Property grasp.mised is not allowed.",
        ),
        ("- GoTo: {breakpoint: during}", 28, 'Value is not accepted. Valid values: "before", "after".'),
    ],
)
def test_what_is_wrong_is_underlined_where_it_stands(
    mission: Editor, node: str, column: int, message: str
) -> None:
    assert mission.squiggles(f"{MISSION}      {node}\n") == [Diagnostic(8, column, message)]


def test_an_attribute_that_no_object_has(mission: Editor) -> None:
    (found,) = mission.squiggles(f'{MISSION}      - Grasp: {{object: "{{item.color}}"}}\n')
    assert (found.line, found.column) == (8, 25)
    assert found.message.startswith('a reference is "{key}" or "{key.attribute}", the attribute one of id, ')


def test_sub_trees_of_the_file_are_no_mistake(mission: Editor) -> None:
    text = MISSION + "      - SortOne: {item: 3}\n      - sort_two\n      - Inverter: {sort_two: {}}\n"
    assert mission.squiggles(text + "  SortOne: GoTo\n  sort_two: GoTo\n") == []


# Completion.


def test_nodes_are_offered_in_a_list_of_children(mission: Editor) -> None:
    offered = mission.proposals(f"{MISSION}      - G|\n")
    assert {"Grasp", "Sequence", "Recover", "SafeRetreat", "GoTo"} <= set(offered)
    assert "camera" not in offered
    assert offered["Grasp"].text == "Grasp:\n    object: "
    assert offered["Grasp"].documentation.startswith("Grasp an object between the fingers from above")


@pytest.mark.parametrize("where", ["      - |\n", "      - Timeout:\n          do:\n            |\n"])
def test_nodes_are_offered_where_nothing_stands_yet(mission: Editor, where: str) -> None:
    assert {"Grasp", "Sequence", "Recover"} <= set(mission.proposals(MISSION + where))


def test_ports_are_offered_inside_a_node(mission: Editor) -> None:
    offered = mission.proposals(f"{MISSION}      - Grasp:\n          |\n")
    assert next(iter(offered)) == "object"
    assert {"object", "force", "speed", "name", "_skipIf", "_onSuccess", "breakpoint"} <= set(offered)
    assert "pose" not in offered
    assert "grip force of each finger" in offered["force"].documentation


def test_ports_and_the_only_child_are_offered_in_a_decorator(mission: Editor) -> None:
    assert {"msec", "do", "Grasp"} <= set(mission.proposals(f"{MISSION}      - Timeout:\n          |\n"))


@pytest.mark.parametrize(
    ("node", "values"),
    [
        ("SafeRetreat: {hand: |}", {"keep", "open", "put_down"}),
        ("GoTo: {pose: |}", {"home", "observe", "rest"}),
        ("Grasp: {force: |}", {"70"}),
        ("Grasp: {object: |}", {'"{item}"'}),
    ],
)
def test_values_are_offered(mission: Editor, node: str, values: set[str]) -> None:
    assert set(mission.proposals(f"{MISSION}      - {node}\n")) == values


def test_causes_are_offered_under_when(mission: Editor) -> None:
    text = f"{MISSION}      - Recover:\n          do: GoTo\n          when:\n            |\n"
    offered = mission.proposals(text)
    assert {"grasp.missed", "grasp.*", "planning.no_path", "*"} <= set(offered)
    said = "The fingers closed and hold nothing. First remedy: observe again."
    assert offered["grasp.missed"].documentation == said


# Hover.


def test_hover_over_a_node(mission: Editor) -> None:
    assert mission.hover(MISSION.replace("Observe", "Obs|erve")) == (
        "#### Observe\n\n"
        "Look through a camera; list the items that are to be taken somewhere.\n\n"
        "A held object comes first, since the hand can grasp nothing else before. The other items follow in "
        "an order that keeps the travel of the empty hand short."
        "\n\nFails with `perception.not_found`, `perception.no_image`.\n\nUses camera."
    )


def test_hover_over_a_bare_node(mission: Editor) -> None:
    text = mission.hover(f"{MISSION}      - Safe|Retreat\n")
    assert text.startswith("#### node\n\nBrake, acknowledge a latched safety stop")


def test_hover_over_a_port(mission: Editor) -> None:
    assert mission.hover(f'{MISSION}      - Grasp: {{object: "{{item}}", fo|rce: 20 N}}\n') == (
        "#### Grasp\n\nmaximum grip force of each finger: the applied force follows from weight and "
        "friction, and is limited by this port, by the item (`force_limit`) and by the gripper\n\n"
        '*number in N, or as "20 N"; more than 0; default: 70 N*'
    )


def test_hover_over_a_cause(mission: Editor) -> None:
    text = f"{MISSION}      - Recover: {{do: GoTo, when: {{grasp.mis|sed: SafeRetreat}}}}\n"
    assert mission.hover(text) == (
        "#### Recover\n\nThe fingers closed and hold nothing. First remedy: observe again."
    )


# A mission's own schema, and other kinds of files.


def test_a_schema_of_one_mission_knows_its_sub_trees_and_bins(server: LanguageServer, tmp_path: Path) -> None:
    text = MISSION + "      - SortOne: {item: x}\n  SortOne: {ports: {item: object}, GoTo: {}}\n"
    registry = NodeRegistry()
    own = one_mission(read_document(tmp_path / "m.yaml", "mission", text), registry)
    schema = tmp_path / "own.json"
    schema.write_text(to_text(mission_schema(registry, own)), encoding="utf-8")
    editor = Editor(server, tmp_path, schema)
    assert editor.squiggles(text) == []
    assert editor.squiggles(text.replace("- SortOne", "- SortTwo")) == [
        Diagnostic(8, 9, "Property SortTwo is not allowed.")
    ]
    assert "SortOne" in editor.proposals(f"{MISSION}      - |\n")
    assert set(editor.proposals(f"{MISSION}      - Place: {{into: |}}\n")) == {
        "red_bin", "green_bin", "blue_bin", '"{item.destination}"'
    }  # fmt: skip


def test_a_scene(scene: Editor) -> None:
    assert scene.squiggles(SCENE) == []
    assert scene.squiggles(SCENE.replace("60 deg", "60 mm")) == [
        Diagnostic(7, 60, 'a number in rad, or with a unit, as "5 deg"')
    ]
    assert set(scene.proposals(SCENE.replace("light_grey", "|"))) >= {"white", "grey", "black"}
    assert scene.hover(SCENE.replace("fov", "f|ov")) == (
        "#### Camera\n\nVertical field of view.\n\n"
        '*more than 0 rad, at most 150 deg; a bare number is in rad; or with a unit, as "5 deg"; '
        "default: 60 deg*"
    )


def test_a_scene_on_a_base_says_only_what_is_different(scene: Editor) -> None:
    text = "picktree: 1\nkind: scene\nbase: three_bins\ncameras: {overhead: {error: [4 mm, 0, 0]}}\n"
    assert scene.squiggles(text) == []
    assert scene.squiggles(text.replace("error", "eror")) == [
        Diagnostic(4, 22, "Property eror is not allowed.")
    ]


def test_cases_offer_causes(server: LanguageServer, tmp_path: Path) -> None:
    cases = Editor(server, tmp_path, ROOT / "schemas/cases.json")
    text = "picktree: 1\nkind: cases\nmission: m.yaml\ncases:\n  a:\n    leaves: {Grasp: {cause: |}}\n"
    offered = cases.proposals(text)
    assert {"grasp.missed", "planning.no_path"} <= set(offered)
    assert offered["grasp.missed"].text == "grasp.missed"

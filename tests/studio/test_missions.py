"""Answers on the text of a mission: picture, edits, faults, forms, rehearsals and scenes."""

from __future__ import annotations

import re
import shutil
from typing import Any

import pytest

from picktree.apps.studio.answers import PageText
from picktree.apps.studio.mission_slice import written
from picktree.files.file_system import ROOT
from picktree.trees import PortDeclaration, PortType
from picktree.world.scene.scene_loading import SHIPPED

from .conftest import Client, Refused, Served

NAME = "sort_by_colour.yaml"
GRASP = "SortOne/Recover/Sequence/Grasp"
TEXT = (ROOT / "examples" / NAME).read_text(encoding="utf-8")


def applied(text: str, changes: list[dict[str, Any]]) -> str:
    for change in reversed(changes):
        text = text[: change["from"]] + change["insert"] + text[change["to"] :]
    return text


def nodes(tree: dict[str, Any]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    todo = [each["root"] for each in tree["trees"]]
    while todo:
        node = todo.pop()
        found[node["id"]] = node
        todo += node["children"]
    return found


def edit(client: Client, text: str = TEXT, **wanted: object) -> tuple[str, str]:
    """Return the text after an edit, and the node that it concerns."""
    answer = client.call("mission.edit", path=NAME, text=text, edit=wanted)
    return applied(text, answer["changes"]), answer["selected"]


def test_the_picture_has_the_places_of_the_text_also_behind_wide_letters(served: Served) -> None:
    wide = TEXT.replace("# Every item", "# 🤖 every item")
    with served.client() as client:
        found = nodes(client.call("mission.tree", path=NAME, text=wide))
    units = wide.encode("utf-16-le")
    start = len(wide[: wide.index("\n  SortOne:\n") + 3].encode("utf-16-le")) // 2
    span = units[2 * (start + found[GRASP]["start"]) : 2 * (start + found[GRASP]["end"])].decode("utf-16-le")
    assert span == 'Grasp: {object: "{item}"}'
    assert [PageText(wide).points(PageText(wide).units(at)) for at in (0, 90, 900)] == [0, 90, 900]


def test_trees_that_the_page_has_are_not_sent_again(served: Served) -> None:
    with served.client() as client:
        main, sort = client.call("mission.tree", path=NAME, text=TEXT)["trees"]
        known = [main["content"], sort["content"]]
        text = TEXT.replace("attempts: 4", "attempts: 5")
        again, changed = client.call("mission.tree", path=NAME, text=text, known=known)["trees"]
        assert again == {key: main[key] for key in ("name", "start", "end", "content")}
        assert changed["content"] not in known
        assert nodes({"trees": [changed]})["SortOne/Recover"]["ports"][0]["text"] == "5"
        # The same lines mean something else once they name a tree of the text.
        renamed = TEXT.replace("SortOne", "Observe")
        main, _ = client.call("mission.tree", path=NAME, text=renamed, known=known)["trees"]
        assert nodes({"trees": [main]})["Main/Repeat/Sequence/Observe"]["symbol"] == "subtree"


def test_a_text_with_a_fault_of_form_keeps_its_picture(served: Served) -> None:
    broken = TEXT.replace('- Grasp: {object: "{item}"}', '- Grasp: {object: "{item')
    with served.client() as client:
        found = client.call("mission.tree", path=NAME, text=broken)
        assert not found["whole"]
        assert {GRASP, "Main/Repeat/Sequence/Observe"} <= set(nodes(found))
        with pytest.raises(Refused, match="fault of form"):
            edit(client, broken, do="remove", node=GRASP)


def test_edits_come_as_replacements_with_the_node_that_they_concern(served: Served) -> None:
    with served.client() as client:
        text, selected = edit(client, do="set", node=GRASP, key="force", value="20 N")
        assert text == TEXT.replace('{object: "{item}"}\n', '{object: "{item}", force: 20 N}\n')
        assert selected == GRASP
        assert edit(client, text, do="set", node=GRASP, key="force", value="") == (TEXT, GRASP)
        place = {"parent": "SortOne/Recover/Sequence", "index": 2}
        text, selected = edit(
            client, do="add", place=place, identity="LetGoAndRetreat", include="library/recovery"
        )
        assert selected == "SortOne/Recover/Sequence/LetGoAndRetreat"
        assert "\ninclude: [library/recovery]\ntrees:\n" in text
        assert client.call("mission.faults", path=NAME, text=text) == []
        text, _ = edit(client, do="wrap", node="Main/Repeat/Sequence/Observe", identity="Recover")
        assert client.call("mission.faults", path=NAME, text=text) == []
        text, _ = edit(client, do="rename_tree", tree="SortOne", name="TakeOne")
        assert "SortOne" not in text
        with pytest.raises(Refused, match="takes no children"):
            edit(
                client, do="move", node=GRASP, place={"parent": "SortOne/Recover/Sequence/Place", "index": 0}
            )
        with pytest.raises(Refused, match="no node 'Main/Nothing'"):
            edit(client, do="remove", node="Main/Nothing")


def test_faults_have_their_place_and_their_fix(served: Served) -> None:
    broken = TEXT.replace("- Grasp:", "- Graps:")
    with served.client() as client:
        (fault,) = client.call("mission.faults", path=NAME, text=broken)
    assert (broken[fault["from"] : fault["to"]], fault["code"], fault["severity"]) == (
        "Graps",
        "P207",
        "error",
    )
    assert applied(broken, [fault["fix"]]) == TEXT


def test_a_form_knows_names_of_the_scene_and_keys_of_the_tree(served: Served) -> None:
    with served.client() as client:
        form = client.call("mission.form", path=NAME, text=TEXT, node="Main/Repeat/Sequence/Observe")
        (camera,) = (port for port in form["ports"] if port["key"] == "camera")
        assert camera["names"] == ["overhead"]
        assert {"items", "item", "rounds"} <= set(form["keys"])
        palette = {each["id"]: each for each in client.call("mission.palette", path=NAME, text=TEXT)["nodes"]}
        assert palette["SortOne"]["kind"] == "subtree"
        assert palette["PickAndPlace"]["include"] == "library/sorting"
        assert palette["Recover"]["wraps"]
        offered = client.call("mission.complete", path=NAME, text=TEXT, line=27, character=14)
        assert "GoTo" in [each["label"] for each in offered["options"]]
        assert "object" in client.call("mission.hover", path=NAME, text=TEXT, line=27, character=14)["text"]


@pytest.mark.parametrize(
    ("value", "kind", "expected"),
    [
        ("20 N", "float", "20 N"),
        ("{force}", "float", '"{force}"'),
        ("[1, 2]", "list of int", "[1, 2]"),
        ("3", "string", '"3"'),
        ("no: colon", "string", '"no: colon"'),
        ("[1, {", "any", '"[1, {"'),
        ('"quoted"', "string", '"quoted"'),
        ("a\nb", "string", "a b"),
    ],
)
def test_what_is_typed_in_a_form_is_quoted_where_yaml_needs_it(value: str, kind: str, expected: str) -> None:
    port = PortDeclaration("port", "port", "in", PortType.parse(kind), "")
    assert written(value, "port", port) == expected


def test_plug_ins_are_left_out_until_the_folder_is_trusted(served: Served) -> None:
    for name in ("probe.yaml", "plugins/probe.py"):
        (served.folder / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(ROOT / "examples" / name, served.folder / name)
    text = (served.folder / "probe.yaml").read_text(encoding="utf-8")
    with served.client() as client:
        found = client.call("mission.tree", path="probe.yaml", text=text)
        assert "is not run" in found["left_out"]
        assert "P262" in [
            each["code"] for each in client.call("mission.faults", path="probe.yaml", text=text)
        ]
        client.call("folder.trust", trusted=True)
        assert client.call("mission.tree", path="probe.yaml", text=text)["left_out"] == ""
        assert client.call("mission.faults", path="probe.yaml", text=text) == []


def test_a_text_that_is_not_saved_is_rehearsed(served: Served) -> None:
    (served.folder / "cases").mkdir()
    with served.client() as client, pytest.raises(Refused, match="there are no cases"):
        client.call("mission.rehearse", path=NAME, text=TEXT)
    (served.folder / NAME).write_text(TEXT, encoding="utf-8")
    shutil.copyfile(ROOT / "examples" / "cases" / NAME, served.folder / "cases" / NAME)
    worse = TEXT.replace("      attempts: 4\n", "      attempts: 1\n")
    with served.client() as client:
        good = client.call("mission.rehearse", path=NAME, text=TEXT)
        assert good["passed"]
        assert good["nodes"][GRASP] == {"reached": 1, "total": 1, "missed": []}
        bad = client.call("mission.rehearse", path=NAME, text=worse)
        assert "missed" in [each["name"] for each in bad["cases"] if not each["passed"]]


def test_a_scene_is_spawned_by_its_seed_and_a_bin_moves_in_its_text(served: Served) -> None:
    scene = re.sub(r"  nut: .*\n|, nut: 1", "", (SHIPPED / "three_bins.yaml").read_text(encoding="utf-8"))
    (served.folder / "cell.yaml").write_text(scene, encoding="utf-8")
    with served.client() as client:

        def show(seed: int, text: str | None = None) -> dict[str, Any]:
            return client.call("scene.show", mission=NAME, scene="cell.yaml", seed=seed, text=text)

        def places(found: dict[str, Any], name: str) -> list[list[float]]:
            return [each["position"] for each in found["bodies"] if each["name"] == name]

        first = show(1)
        assert first["file"] == "cell.yaml"
        assert places(first, "item_01") == places(show(1), "item_01") != places(show(2), "item_01")
        moved = client.call("scene.move", text=scene, fixture="red_bin", x=0.4, y=0.5)
        assert moved["text"] == scene.replace("at: [0.42, 0.48, 0]", "at: [0.4, 0.5, 0]")
        assert places(show(1, moved["text"]), "red_bin")[0][:2] == [0.4, 0.5]
        with pytest.raises(Refused, match="not below the folder"):
            client.call("scene.show", mission=NAME, scene="../../outside.yaml", seed=1)

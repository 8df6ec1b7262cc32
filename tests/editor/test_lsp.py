"""`picktree lsp`, driven over stdio as editors drive it. `|` is the cursor of a text."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.cli import answer
from picktree.authoring.editor import read_repaired
from picktree.logs import install_command

from .language_server import LanguageServer, Proposal

HEAD = "picktree: 1\nkind: mission\nscene: three_bins\ninclude: [library/recovery]\ntrees:\n"
MAIN = f'{HEAD}  Main:\n    Sequence:\n      - Observe: {{objects: "{{items}}"}}\n'


class Editor:
    """An open file, and questions about the place of its cursor."""

    def __init__(self, server: LanguageServer, folder: Path) -> None:
        self.server, self.path = server, folder / "m.yaml"
        server.open(self.path, "")

    def at(self, text: str) -> tuple[int, int]:
        before, cursor, behind = text.partition("|")
        assert cursor
        self.server.change(self.path, before + behind)
        self.text = before + behind
        return before.count("\n") + 1, len(before.rpartition("\n")[2]) + 1

    def check(self, text: str) -> list[dict[str, Any]]:
        """What is underlined, errors first."""
        self.at(text + "|")
        return sorted(self.server.underlined(), key=lambda fault: fault["severity"])

    def complete(self, text: str) -> dict[str, Proposal]:
        return self.server.complete(self.path, *self.at(text))

    def hover(self, text: str) -> str:
        return self.server.hover(self.path, *self.at(text))

    def definition(self, text: str) -> tuple[str, int, int] | None:
        found = self.server.ask("textDocument/definition", self.path, *self.at(text))
        if found is None:
            return None
        start = found["range"]["start"]
        return found["uri"].rpartition("/")[2], start["line"] + 1, start["character"] + 1

    def rename(self, text: str, name: str) -> str:
        found = self.server.ask("textDocument/rename", self.path, *self.at(text), newName=name)
        return found["message"] if "message" in found else applied(self.text, found["changes"])

    def fixed(self, text: str) -> str:
        """The text after the first quick fix of all faults."""
        actions = [fix for fault in self.check(text) for fix in self.server.fixes(self.path, fault)]
        return applied(self.text, actions[0]["edit"]["changes"])


def applied(text: str, changes: Mapping[str, list[dict[str, Any]]]) -> str:
    """The text after the edits of one file; their characters count UTF-16 units, as the client's do."""

    def place(edit: dict[str, Any]) -> tuple[int, int]:
        return edit["range"]["start"]["line"], edit["range"]["start"]["character"]

    ((_, edits),) = changes.items()
    lines = [line.encode("utf-16-le") for line in text.split("\n")]
    for edit in sorted(edits, key=place, reverse=True):
        (row, start), end = place(edit), edit["range"]["end"]
        assert end["line"] == row
        new = edit["newText"].encode("utf-16-le")
        lines[row] = lines[row][: 2 * start] + new + lines[row][2 * end["character"] :]
    return b"\n\0".join(lines).decode("utf-16-le")


@pytest.fixture
def editor(ours: LanguageServer, tmp_path: Path) -> Editor:
    return Editor(ours, tmp_path)


def test_what_check_finds_is_underlined_as_one_types(editor: Editor) -> None:
    (fault,) = editor.check(MAIN + "      - Graps: {object: x}\n")
    assert fault["code"] == "P207"
    assert fault["range"] == {"start": {"line": 8, "character": 8}, "end": {"line": 8, "character": 13}}
    assert fault["message"] == "unknown node 'Graps' (did you mean 'Grasp'?)"
    # The linter, too: a warning.
    found = editor.check(MAIN + "      - Sequence: [AlwaysSuccess]\n")
    assert [each["severity"] for each in found] == [2] * len(found) != []
    found = editor.check(MAIN + "")
    assert [each["code"] for each in found if each["severity"] == 1] == []


def test_errors_of_a_large_mission_do_not_wait_for_the_linter(editor: Editor) -> None:
    large = MAIN + "      - {Sequence: [AlwaysSuccess]}  # a comment\n" * 400
    assert editor.check(large) == []
    warned = editor.server.underlined()
    assert {each["severity"] for each in warned} == {2}
    # Until the linter has looked again, its warnings stay.
    assert editor.check(large + "# more\n") == warned
    assert editor.server.underlined() == warned
    (fault,) = editor.check(large + "      - Graps: {object: x}\n")
    assert fault["severity"] == 1


def test_faults_of_each_kind_and_of_files_named_are_underlined(editor: Editor, tmp_path: Path) -> None:
    for kind in ("scene", "robot", "faults", "cases", "plan"):
        found = editor.check(f"picktree: 1\nkind: {kind}\nnonsense: 3\n")
        assert any("nonsense" in each["message"] for each in found), kind
    (tmp_path / "parts.yaml").write_text("picktree: 1\nkind: mission\nlibrary: true\ntrees: {A: Obserf}\n")
    found = editor.check(MAIN.replace("[library/recovery]", "[parts.yaml]") + "")
    (fault,) = [each for each in found if each["severity"] == 1]
    assert fault["range"]["start"]["line"] == 3
    (other,) = fault["relatedInformation"]
    assert other["location"]["uri"].endswith("/parts.yaml")
    assert other["location"]["range"]["start"] == {"line": 3, "character": 11}
    found = editor.check("services: {web: {image: x}}\n")
    assert found == []


def test_columns_count_as_the_client_counts(editor: Editor) -> None:
    found = editor.check(MAIN + "      - {Observe: {name: \U0001f916, camera: overhad}}\n")
    (fault,) = [each for each in found if "overhad" in each["message"]]
    assert fault["range"]["start"]["character"] == 37
    assert (
        editor.fixed(editor.text).splitlines()[-1]
        == "      - {Observe: {name: \U0001f916, camera: overhead}}"
    )


@pytest.mark.parametrize(
    ("text", "offered", "written"),
    [
        ("Sequence: [G|]", "Grasp", 'Grasp: {object: ${1:"{item\\}"}\\}'),
        ("Sequence: [|]", "Observe", "Observe"),
        ("Sequence: [|", "Sequence", "Sequence: [$1]"),
        ("Sequence:\n      - |", "Fallback", "Fallback:\n    - $0"),
        ("Sequence:\n      - Obs|\n      - Halt: {", "Observe", "Observe"),
        ("Sequence: [LookA|]", "LookAgain", "LookAgain"),
        ("Grasp: {|}", "force", "force: $0"),
        ("Grasp: {object: x, fo|: 3}", "force", "force"),
        ("Grasp:\n      |", "_skipIf", "_skipIf: $0"),
        ("Observe: {camera: |}", "overhead", "overhead"),
        ("Observe: {camera: |", "overhead", "overhead"),
        ("GoTo: {pose: |}", "home", "home"),
        ("Place: {object: x, into: |}", "red_bin", "red_bin"),
        ("SafeRetreat: {hand: o|", "open", "open"),
        ("Recover: {do: Observe, when: {gr|}}", "grasp.missed", "grasp.missed: $0"),
        ("Delay: {delay_msec: 3, |}", "Observe", "Observe: {$1\\}"),
        ("Inverter: {do: |}", "Grasp", '{Grasp: {object: ${1:"{item\\}"}\\}\\}'),
        ('Sequence: [Observe: {objects: "{items}"}, Grasp: {object: "{|}"}]', "items", "items"),
        ('Sequence: [Observe: {objects: "{items}"}, Grasp: {object: "{it|', "items", 'items\\}"'),
        (
            'ForEach: {list: "{a}", item: "{item}", do: {Grasp: {object: "{item.|}"}}}',
            "item.kind",
            "item.kind",
        ),
        ('Sequence: [Observe: {objects: "{items}"}, Condition: {if: "ite|"}]', "items", "items"),
        ("Observe: {_skipIf: ho|}", "holding", "holding"),
        ('Sequence: [Observe: {objects: "{items}"}, Grasp: {object: "{= ite|[0]}"}]', "items", "items"),
        ('Sequence: [Observe: {objects: "{items}"}, Grasp: {object: a, speed: "{= 1 / le|', "items", "items"),
        ('GoTo: {pose: home, speed: "{= 1 / items_l|}"}', "items_left", "items_left"),
    ],
)
def test_completion_offers_what_may_stand_there(
    editor: Editor, text: str, offered: str, written: str
) -> None:
    found = editor.complete(f"{HEAD}  Main:\n    {text}\n")
    assert found[offered].text == written


def test_completion_offers_nothing_that_cannot_stand_there(editor: Editor) -> None:
    inside = editor.complete(MAIN + "      - Grasp: {object: x, |}\n")
    assert "object" not in inside and "Grasp" not in inside
    assert list(editor.complete(MAIN + '      - Grasp: {object: "{|}"}\n')) == ["items"]
    assert list(editor.complete(MAIN + "      - Observe: {camera: |}\n")) == ["overhead"]


def test_a_subtree_of_the_library_is_offered_with_its_include(editor: Editor) -> None:
    place = editor.at(MAIN.replace("include: [library/recovery]\n", "") + "      - Look|\n")
    found = editor.server.ask("textDocument/completion", editor.path, *place)
    (item,) = [each for each in found["items"] if each["label"] == "LookAgain"]
    (edit,) = item["additionalTextEdits"]
    assert (edit["newText"], edit["range"]["start"]["line"]) == ("include: [library/recovery]\n", 3)


@pytest.mark.parametrize(
    ("kind", "text", "offered"),
    [
        ("scene", "ba|", "base"),
        ("scene", "robot: |", "gen3"),
        ("robot", "|", "urdf"),
        ("faults", "faults:\n  - {fault: |}", "slip"),
        ("cases", "cases:\n  A: {|}", "doc"),
        ("plan", "|", "missions"),
    ],
)
def test_completion_knows_the_other_kinds_of_files(
    editor: Editor, kind: str, text: str, offered: str
) -> None:
    assert offered in editor.complete(f"picktree: 1\nkind: {kind}\n{text}\n")


def test_hover_explains_nodes_ports_and_keys(editor: Editor) -> None:
    assert editor.hover(MAIN + "      - Gra|sp: {object: x}\n").startswith(
        "Grasp an object between the fingers"
    )
    assert editor.hover(MAIN + "      - GoTo: {po|se: home}\n").endswith("default: home*")
    assert "default: 70 N" in editor.hover(MAIN + "      - Grasp: {object: x, for|ce: 3}\n")
    assert editor.hover(MAIN + "      - [AlwaysSu|ccess]\n") == ""
    key = editor.hover(MAIN + '      - Grasp: {object: "{ite|ms}"}\n')
    assert key.startswith("Key `items` of the tree Main.\n\nWritten by Observe, line 8.")


def test_definition_leads_to_subtrees_also_of_the_library(editor: Editor) -> None:
    own = MAIN + "      - Pi|ck\n  Pick: AlwaysSuccess\n"
    assert editor.definition(own) == ("m.yaml", 10, 3)
    found = editor.definition(MAIN + "      - LookA|gain\n")
    assert found is not None and found[0] == "recovery.yaml"
    assert editor.definition(MAIN.replace("recovery]", "reco|very]")) == ("recovery.yaml", 1, 1)
    assert editor.definition(MAIN + '      - Grasp: {object: "{ite|ms}"}\n') == ("m.yaml", 8, 28)
    found = editor.definition(MAIN + "      - Gra|sp: {object: x}\n")
    assert found is not None and found[0] == "grasp.py"
    assert editor.definition(MAIN + "      - Gra|ps: {object: x}\n") is None


def test_rename_changes_a_key_in_its_whole_tree(editor: Editor) -> None:
    text = MAIN + (
        "      - Condition: {if: \"count(items) > 0 and kind != 'items'\"}\n"
        '      - Observe: {_onSuccess: "items := items; more = 1"}\n'
        '      - Sub: {items: "{it|ems}"}\n'
        '      - Grasp: {object: "{= items[len(items) - 1]}"}\n'
        '  Sub: {ports: {items: list of object}, do: {Grasp: {object: "{items}"}}}\n'
    )
    assert editor.rename(text, "found").splitlines()[7:] == [
        '      - Observe: {objects: "{found}"}',
        "      - Condition: {if: \"count(found) > 0 and kind != 'items'\"}",
        '      - Observe: {_onSuccess: "found := found; more = 1"}',
        '      - Sub: {items: "{found}"}',
        '      - Grasp: {object: "{= found[len(found) - 1]}"}',
        '  Sub: {ports: {items: list of object}, do: {Grasp: {object: "{items}"}}}',
    ]
    port = text.replace("|", "").replace("ports: {items", "ports: {it|ems")
    assert editor.rename(port, "all").splitlines()[10:] == [
        '      - Sub: {all: "{items}"}',
        '      - Grasp: {object: "{= items[len(items) - 1]}"}',
        '  Sub: {ports: {all: list of object}, do: {Grasp: {object: "{all}"}}}',
    ]
    assert editor.rename(text, "more") == "the tree 'Main' has a key 'more' already"
    assert "is not a valid key" in editor.rename(text, "a b")
    assert editor.rename(MAIN.replace("Observe", "Obs|erve"), "x") == "there is no key of the blackboard here"


def test_a_key_of_main_is_renamed_in_all_trees(editor: Editor) -> None:
    text = MAIN + (
        '      - SetBlackboard: {value: 1, output_key: "{count}"}\n'
        "      - Sub: {_skipIf: count > 3 and @count < 9}\n"
        "  Sub:\n"
        "    Sequence:\n"
        '      - Script: {code: "count := 1; @co|unt += count"}\n'
        '      - Log: {message: x, value: "{@count}"}\n'
    )
    here = text.replace("|", "")
    renamed = [
        '      - SetBlackboard: {value: 1, output_key: "{done}"}',
        "      - Sub: {_skipIf: done > 3 and @done < 9}",
        "  Sub:",
        "    Sequence:",
        '      - Script: {code: "count := 1; @done += count"}',
        '      - Log: {message: x, value: "{@done}"}',
    ]
    assert editor.rename(text, "done").splitlines()[8:] == renamed
    assert editor.rename(here.replace('"{cou', '"{co|u'), "done").splitlines()[8:] == renamed
    assert editor.rename(text, "items") == "the tree 'Main' has a key 'items' already"
    local = editor.rename(here.replace('"count :=', '"cou|nt :='), "n").splitlines()
    assert local[8:] == [*here.splitlines()[8:12], '      - Script: {code: "n := 1; @count += n"}', local[-1]]
    hover = editor.hover(text)
    assert hover.startswith("Key `count` of the tree Main.\n\nWritten by SetBlackboard, line 9.")
    assert editor.definition(text) == ("m.yaml", 9, 47)


def test_an_open_file_counts_before_the_one_on_the_disk(editor: Editor, tmp_path: Path) -> None:
    head = "picktree: 1\nkind: mission\nlibrary: true\ntrees:\n"
    parts = tmp_path / "parts.yaml"
    parts.write_text(f"{head}  Pick: AlwaysSuccess\n")
    text = MAIN.replace("library/recovery", "parts.yaml") + "      - Lift\n"
    (fault,) = [each for each in editor.check(text) if each["severity"] == 1]
    assert fault["message"].startswith("unknown node 'Lift'")
    editor.server.open(parts, f"{head}  Pick: AlwaysSuccess\n  Lift: AlwaysSuccess\n")
    assert [each for each in editor.check(text) if each["severity"] == 1] == []
    assert editor.definition(text.replace("Lift", "Li|ft")) == ("parts.yaml", 6, 3)
    assert "Lift" in editor.complete(text.replace("Lift", "|"))


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("Graps: {object: x}", "Grasp: {object: x}"),
        ("GoTo: {pos: home}", "GoTo: {pose: home}"),
        ("GoTo: {pose: hme}", "GoTo: {pose: home}"),
        ("Condition: {if: time > 3 && holding}", "Condition: {if: time > 3 and holding}"),
        ("Grasp: {object: {items}}", 'Grasp: {object: "{items}"}'),
        ("Grasp: {object: '{itms}'}", "Grasp: {object: '{items}'}"),
        ("Grasp: {object: “{items}”}", 'Grasp: {object: "{items}"}'),
        ("GoTo:\u00a0{pose: home}", "GoTo: {pose: home}"),
        ("GoTo: {pose：home}", "GoTo: {pose: home}"),
        ("GoTo: {pose:home}", "GoTo: {pose: home}"),
        ("GoTo:{pose: home}", "GoTo: {pose: home}"),
        ("Sleep: {msec: 0,5 s}", "Sleep: {msec: 0.5 s}"),
        ("GoTo: {pose: home}\n      Observe: {camera: overhead}",
         "GoTo: {pose: home}\n      - Observe: {camera: overhead}"),
    ],
)  # fmt: skip
def test_a_quick_fix_writes_what_the_hint_names(editor: Editor, wrong: str, right: str) -> None:
    assert editor.fixed(f"{MAIN}      - {wrong}") == f"{MAIN}      - {right}"


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("a: {b: [1, 2\nc: 3\n", ["a", "c"]),
        ("a: {b: 'x\nc: 3\n", ["a", "c"]),
        ("a: 1]\nc: 3\n", ["a", "c"]),
        ("a: 1\nb\nc: 3\n", ["a", "b", "c"]),
        ("a: 1\n\t}{ ]\nc: 3\n", ["a", "c"]),
        ('a: "{it\nc: 3\n', ["a", "c"]),
    ],
)
def test_a_text_that_is_being_written_is_read(text: str, keys: list[str]) -> None:
    reading = read_repaired(text, "m.yaml")
    assert reading is not None and list(reading[0].root.entries) == keys


def test_without_pygls_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "picktree.apps.cli.language_server", raising=False)
    for name in [name for name in sys.modules if name.partition(".")[0] == "pygls"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pygls", None)
    monkeypatch.setattr("picktree.apps.cli.author_commands.keep_stdout", lambda: sys.stdout)
    assert answer(["lsp"]) == 2
    assert capsys.readouterr().err == f"The language server needs the extra 'lsp': {install_command('lsp')}\n"

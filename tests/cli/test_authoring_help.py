"""`picktree schema` and `picktree nodes`: what an author asks of the language itself."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from picktree.apps.cli import answer

ROOT = Path(__file__).parents[2]
MISSION = ROOT / "examples/sort_by_colour.yaml"


def test_schema_goes_to_stdout_or_into_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["schema", "robot"]) == 0
    text = capsys.readouterr().out
    assert json.loads(text)["title"] == "picktree robot"
    assert answer(["schema", "robot", "-o", str(tmp_path / "robot.json")]) == 0
    assert capsys.readouterr().out == ""
    assert (tmp_path / "robot.json").read_text(encoding="utf-8") == text


def test_schema_of_one_mission_knows_its_sub_trees(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["schema", "mission", "--mission", str(MISSION)]) == 0
    definitions = json.loads(capsys.readouterr().out)["definitions"]
    assert definitions["tree.SortOne"]["anyOf"] == [{"required": ["item"]}, {"required": ["_autoremap"]}]
    assert set(definitions["node"]["properties"]) >= {"Grasp", "SortOne"}


def test_schema_and_reference_of_a_mission_have_its_plug_ins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plugin = """\
from picktree.trees import ConditionNode
from picktree.trees import In, port

class Dusk(ConditionNode):
    \"\"\"Whether it is getting dark.\"\"\"

    lux: In[float] = port("brightness below which it is", default=10.0, least=0)

    def answer(self, world):
        return True

NODES = (Dusk,)
"""
    (tmp_path / "dusk.py").write_text(plugin)
    mission = tmp_path / "m.yaml"
    mission.write_text("picktree: 1\nkind: mission\nplugins: [dusk.py]\ntrees: {Main: Dusk}\n")
    assert answer(["nodes", "Dusk", "--mission", str(mission)]) == 0
    out = capsys.readouterr().out
    assert out.startswith(
        'Dusk (condition)\n\nWhether it is getting dark.\n\nInputs\n  lux: number, or as "50 %"; at least 0;'
    )
    assert answer(["schema", "mission", "--mission", str(mission)]) == 0
    assert "node.Dusk" in json.loads(capsys.readouterr().out)["definitions"]


def test_a_plug_in_that_fails_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.py").write_text("1 / 0\n")
    mission = tmp_path / "m.yaml"
    mission.write_text("picktree: 1\nkind: mission\nplugins: [bad.py]\ntrees: {Main: GoTo}\n")
    assert answer(["nodes", "--mission", str(mission)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "bad.py" in err
    assert "ZeroDivisionError" in err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("schema scene --mission m.yaml", "--mission is for the schema of missions, not of scene"),
        ("nodes Grsp", "there is no node 'Grsp' (did you mean 'Grasp'?)"),
        ("nodes Precondition", "there is no node 'Precondition' (write the condition at the node itself, "),
        ("schema mission -o /nowhere/at/all.json", "/nowhere/at/all.json cannot be written: "),
    ],
)
def test_bad_input_is_a_sentence(line: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(line.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(said)


def test_unknown_kind_lists_the_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["schema", "missoin"]) == 2
    assert "'mission', 'scene', 'robot', 'faults', 'cases'" in capsys.readouterr().err


def test_all_nodes_by_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["nodes", "--shipped"]) == 0
    out = capsys.readouterr().out
    titles = [line for line in out.splitlines() if line and not line.startswith(" ")]
    assert titles == ["Actions", "Conditions", "Control nodes", "Decorators"]
    assert "\n  Grasp  " in out


def test_nodes_as_one_json_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["nodes", "Grasp", "--json"]) == 0
    (node,) = json.loads(capsys.readouterr().out)["nodes"]
    assert (node["id"], node["kind"], node["uses"]) == ("Grasp", "action", ["arm", "gripper"])
    force = next(port for port in node["ports"] if port["key"] == "force")
    assert (force["unit"], force["default"], force["bounds"]) == ("N", "70 N", "more than 0")
    planning = next(cause for cause in node["causes"] if cause["name"] == "planning.*")
    assert "planning.no_path" in [member["name"] for member in planning["members"]]

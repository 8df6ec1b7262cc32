"""Missions, runs and batches in Python."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import picktree as pt
from picktree.trees import Skill, Steps
from picktree.world import Cause, register_cause

from ..rooms import ROOT

ONE_PICK = ROOT / "examples" / "one_pick.yaml"


def one_pick() -> pt.Sequence:
    return pt.Sequence(
        pt.Observe(camera="overhead", objects="{items}"),
        pt.ForEach(
            pt.Grasp(object="{item}"),
            pt.Place(object="{item}", into="{item.destination}"),
            in_="{items}",
            out="{item}",
            most=1,
        ),
        pt.nodes.GoTo(pose="home"),
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> pt.Run:
    """The mission of examples/one_pick.yaml, made in Python."""
    mission = pt.Mission(one_pick(), scene="sort_small", goal="sorted >= 1 and misplaced == 0")
    return pt.run(mission, seed=1, backend="kinematic", out=tmp_path_factory.mktemp("runs"))


def test_run_of_a_tree_is_that_of_its_file(run: pt.Run, tmp_path: Path) -> None:
    other = pt.run(ONE_PICK, seed=1, backend="kinematic", out=tmp_path)
    assert (run.status, run.digest) == ("success", other.digest)


def test_log_holds_the_mission(run: pt.Run) -> None:
    text = run.record.log.attachment("mission.yaml").decode()
    assert text == pt.Mission(one_pick(), scene="sort_small", goal="sorted >= 1 and misplaced == 0").text


def test_run_answers_from_its_log(run: pt.Run, tmp_path: Path) -> None:
    assert run.explain().startswith("success: the mission succeeded and its goal is reached: 1 of 4 items")
    assert run.show(at=2.0, size=(160, 100)).pixels.shape == (100, 160, 3)
    assert run.report(tmp_path / "run.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert "<td>1 of 4 sorted, 0 misplaced, 3 left</td>" in run._repr_html_()
    with pytest.raises(pt.PicktreeError, match="there is no moment 999"):
        run.show(at=999.0)


def test_parameters_reach_the_nodes(tmp_path: Path) -> None:
    run = pt.run(
        one_pick(), scene="sort_small", backend="kinematic", out=tmp_path, parameters={"Grasp.force": "12 N"}
    )
    (node,) = (node for node in run.record.tree_at(0.0).nodes if node.id == "Grasp")
    assert node.ports["force"] == "12 N"


def test_check_has_errors_with_their_places_and_warnings() -> None:
    warned = pt.Mission(one_pick(), scene="sort_small").check()
    assert warned
    assert {(fault.code, fault.severity) for fault in warned.warnings} == {
        ("P310", "warning"), ("P330", "warning"),
    }  # fmt: skip
    faulty = pt.Mission(pt.Sequence(pt.Observe(camera="overhed")), scene="sort_small")
    report = faulty.check()
    assert not report
    assert [(fault.code, fault.where) for fault in report.errors] == [("P240", "Main/Sequence/Observe")]
    assert "did you mean 'overhead'?" in repr(report)
    assert "P240" in (faulty._repr_html_() or "")
    with pytest.raises(pt.PicktreeError, match="port 'camera'"):
        pt.run(faulty)


def test_file_that_is_no_mission_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("picktree: 1\nkind: scene\n")
    with pytest.raises(
        pt.PicktreeError, match=r"scene.yaml:2:7: kind: this is a scene file; a mission file is"
    ):
        pt.load(tmp_path / "scene.yaml")


def test_drawing_is_that_of_the_command(tmp_path: Path) -> None:
    mission = pt.load(ROOT / "examples" / "sort_by_colour.yaml")
    mission.render(tmp_path / "tree.svg")
    assert (tmp_path / "tree.svg").read_text() == (ROOT / "docs" / "tree.svg").read_text()
    assert mission._repr_svg_() == (ROOT / "docs" / "tree.svg").read_text()
    with pytest.raises(pt.PicktreeError, match=r"a picture is a file that ends in \.svg"):
        mission.render(tmp_path / "tree.jpg")


def test_batch_refuses_a_port_that_no_node_has(tmp_path: Path) -> None:
    mission = pt.Mission(one_pick(), scene="sort_small", name="one pick")
    with pytest.raises(
        pt.PicktreeError, match=r"^Grasp\.forse: Grasp has no input 'forse' \(did you mean 'force'"
    ):
        pt.batch(mission, seeds=[1], settings={"Grasp.forse": [10]}, out=tmp_path / "forces")
    assert pt.load(tmp_path / "forces" / "mission.yaml").text == mission.text


PLUGIN = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
"""The skill that docs/plugins.md shows."""


def test_skill_of_the_documentation_works_in_yaml_and_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "probe.py").write_text(PLUGIN, encoding="utf-8")
    probe = pt.nodes.plugin("plugins/probe.py").Probe
    with pt.Cell("sort_small", backend="kinematic") as cell:
        assert cell.run(pt.nodes.GoTo(pose="home"))
        felt = cell.run(probe(depth="600 mm"))
        missed = cell.run(probe(depth="10 mm"))
    assert abs(felt.outputs["height"]) < 0.002  # type: ignore[arg-type]
    assert (missed.cause, missed.remedy) == ("probe.nothing", "probe deeper")
    with pytest.raises(TypeError, match=r"^Probe has no port 'dept' \(did you mean 'depth'\?\)$"):
        probe(dept=1)
    pt.Sequence(pt.nodes.GoTo(pose="home"), probe(depth="600 mm", height="{table}")).save(
        "feel.yaml", scene="sort_small"
    )
    assert "plugins: [plugins/probe.py]\n" in Path("feel.yaml").read_text()
    run = pt.run("feel.yaml", backend="kinematic")
    (written,) = (w.value for t in run.record.log.ticks() for w in t.record.writes if w.key == "Main/table")
    assert written == pytest.approx(felt.outputs["height"], abs=1e-3)


def test_plug_in_that_lies_elsewhere_runs_and_cannot_be_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    shutil.copy(ROOT / "examples" / "plugins" / "probe.py", "elsewhere")
    (tmp_path / "here").mkdir()
    probe = pt.nodes.plugin("elsewhere/probe.py").Probe
    assert pt.Mission(probe(), scene="sort_small", folder="here").check().errors == ()
    with pytest.raises(
        pt.PicktreeError, match=r"^Probe is defined in .*elsewhere/probe.py: a mission file names"
    ):
        probe().save("here/m.yaml")


def test_class_of_a_notebook_runs(tmp_path: Path) -> None:
    tired = register_cause(Cause("notebook.tired", "It is tired.", "wait"))

    class Wave(Skill):
        """Wave once."""

        causes = (tired,)

        def run(self, world: object) -> Steps:
            yield

    with pt.Cell("sort_small", backend="kinematic") as cell:
        assert cell.run(pt.Sequence(Wave(), Wave()), log=tmp_path).seconds == pytest.approx(0.1)
    with pytest.raises(pt.PicktreeError, match=r"^Wave is defined in "):
        Wave().save(tmp_path / "wave.yaml")


def test_plug_in_that_is_none_says_why(tmp_path: Path) -> None:
    (tmp_path / "empty.py").write_text("")
    with pytest.raises(
        pt.PicktreeError, match=r"^the plug-in 'empty.py' has no NODES, a tuple of node classes"
    ):
        pt.nodes.plugin(tmp_path / "empty.py")

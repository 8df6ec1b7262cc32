"""Plug-ins: a node of one's own is like a built-in one, and whatever is wrong with it is one clear fault."""

from __future__ import annotations

import importlib
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from picktree.authoring import check_mission
from picktree.files import FileError, PicktreeError
from picktree.files.yaml import read_document
from picktree.session.run_recipe import mission_files, plugin_versions
from picktree.trees import Mission
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.world import cause_named

from .waving import WAVE, below, forgotten, mission


@pytest.fixture(autouse=True)
def alone(tmp_path: Path) -> Iterator[None]:
    """A plug-in `wave.py`, forgotten afterwards."""
    (tmp_path / "wave.py").write_text(WAVE)
    with forgotten():
        yield


def without_plugins(trees: str, registry: NodeRegistry | None = None) -> Mission:
    """A mission that names none."""
    text = f"picktree: 1\nkind: mission\ntrees: {trees}\n"
    return parse_mission(text, Path("m.yaml"), registry or NodeRegistry())


# A node of one's own.


def test_a_node_of_a_plug_in_is_declared_and_checked_like_any_other(tmp_path: Path) -> None:
    read = mission(tmp_path, "{Main: {Recover: {do: {Wave: {times: 2}}, when: {wave.tired: Wave}}}}")
    (wave, handler) = read.main.root.children
    assert (wave.id, handler.id) == ("Wave", "Wave")
    assert str(cause_named("wave.tired").sentence) == "The arm is tired."
    with pytest.raises(FileError) as caught:
        mission(tmp_path, "{Main: {Recover: {do: {Wave: {tmies: 2}}, when: {wave.tierd: Wave}}}}")
    assert [str(f).split(": ", 1)[1] for f in caught.value.faults] == [
        "Main/Recover/Wave: Wave has no port 'tmies' (did you mean 'times'?)",
        "Main/Recover: no cause is called 'wave.tierd' (did you mean 'wave.tired'?)",
    ]


def test_the_registry_that_was_given_does_not_change(tmp_path: Path) -> None:
    base = NodeRegistry()
    parse_mission(
        "picktree: 1\nkind: mission\nplugins: [wave.py]\ntrees: {Main: Wave}\n", tmp_path / "m.yaml", base
    )
    assert base.find("Wave") is None


def test_causes_of_a_plug_in_are_known_to_the_missions_that_name_it(tmp_path: Path) -> None:
    with_wave = NodeRegistry()
    with_wave.add_plugin("wave.py", tmp_path)
    assert "wave.tired" in [cause.name for cause in with_wave.causes]
    assert "wave.tired" not in [cause.name for cause in NodeRegistry().causes]
    with pytest.raises(FileError, match=r"no cause is called 'wave.tired'"):
        without_plugins("{Main: {Recover: {do: AlwaysSuccess, when: {wave.tired: AlwaysSuccess}}}}")


@pytest.mark.parametrize("pattern", ["wave.tired", "wave.*"])
def test_a_cause_that_no_node_declares_is_told_from_an_unknown_one(tmp_path: Path, pattern: str) -> None:
    (tmp_path / "wave.py").write_text(WAVE.replace("causes = (TIRED,)", "causes = ()"))
    body = "{Main: {Recover: {do: Wave, when: {%s: AlwaysSuccess}}}}"
    with pytest.raises(FileError) as caught:
        mission(tmp_path, body % pattern)
    assert str(caught.value).endswith(
        f"Main/Recover: '{pattern}' is registered by wave.py, but no node declares it (add it to the "
        "'causes' of the skill in wave.py that fails with it)"
    )
    with pytest.raises(FileError, match=r"no cause is called 'wave.tierd'"):
        mission(tmp_path, body % "wave.tierd")


def test_the_same_file_is_run_once_and_an_edited_one_again(tmp_path: Path) -> None:
    first, again = mission(tmp_path).main.root.node, mission(tmp_path).main.root.node
    assert first is again
    (tmp_path / "wave.py").write_text(
        WAVE.replace("is tired", "must rest").replace("wave.tired", "wave.sore")
    )
    assert mission(tmp_path).main.root.node is not first
    assert cause_named("wave.sore").sentence == "The arm must rest."
    with pytest.raises(PicktreeError, match=r"unknown cause 'wave.tired'"):
        cause_named("wave.tired")


def test_a_faulty_edit_leaves_what_was_there(tmp_path: Path) -> None:
    first = mission(tmp_path).main.root.node
    for wrong in (WAVE + "1/0\n", WAVE.replace("NODES", "NODE"), "register_cause = 3"):
        (tmp_path / "wave.py").write_text(wrong)
        with pytest.raises(FileError):
            mission(tmp_path)
        assert cause_named("wave.tired").sentence == "The arm is tired."
    (tmp_path / "wave.py").write_text(WAVE)
    assert mission(tmp_path).main.root.node is first


def test_what_it_prints_goes_to_stderr(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "wave.py").write_text(WAVE + "print('hello')\nimport os\nos.system('echo from a child')\n")
    mission(tmp_path)
    out, err = capfd.readouterr()
    assert out == ""
    assert sorted(err.splitlines()) == ["from a child", "hello"]


def test_a_mission_carries_the_sources_of_its_plug_ins(tmp_path: Path) -> None:
    (source,) = mission(tmp_path, "{Main: AlwaysSuccess}").sources
    assert (source.name, source.file, source.source) == ("wave.py", tmp_path / "wave.py", WAVE.encode())


def test_the_plug_in_of_an_included_file_lies_beside_that_file(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "wave.py").write_text(WAVE)
    (tmp_path / "parts" / "greet.yaml").write_text(
        "picktree: 1\nkind: mission\nlibrary: true\nplugins: [wave.py]\ntrees: {Greet: Wave}\n"
    )
    head = "picktree: 1\nkind: mission\ninclude: [parts/greet.yaml]\n"
    read = parse_mission(f"{head}trees: {{Main: Greet}}\n", tmp_path / "m.yaml", NodeRegistry())
    assert read.trees["Greet"].root.id == "Wave"
    assert [file.name for file in mission_files(read)] == [
        "mission.yaml", "include/parts/greet.yaml", "plugin/parts/wave.py"
    ]  # fmt: skip
    (tmp_path / "parts" / "wave.py").write_text("1/0")
    with pytest.raises(FileError) as caught:
        parse_mission(f"{head}trees: {{Main: Greet}}\n", tmp_path / "m.yaml", NodeRegistry())
    assert str(caught.value).startswith(
        f"{tmp_path}/parts/greet.yaml:4:11: plugins[0]: the plug-in 'wave.py' cannot be imported: Zero"
    )


def test_a_ctrl_c_while_a_plug_in_is_imported_is_the_users(tmp_path: Path) -> None:
    (tmp_path / "wave.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        mission(tmp_path)
    assert signal.getsignal(signal.SIGINT) is before


# Installed plug-ins.


def install(site: Path, source: str, value: str = "cell_skills", module: str = "cell_skills") -> None:
    """Write the files that pip installs for a distribution with one module and one entry point."""
    (site / f"{module}.py").write_text(source)
    info = site / "my_cell-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-cell\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(f"[picktree.nodes]\na_cell = {value}\n")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that distributions are found in."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    importlib.invalidate_caches()
    yield folder
    sys.modules.pop("cell_skills", None)


def check(text: str) -> list[str]:
    document = read_document(Path("m.yaml"), "mission", f"picktree: 1\nkind: mission\n{text}\n")
    return [str(found) for found in check_mission(document, NodeRegistry()).faults]


@pytest.mark.parametrize("value", ["cell_skills", "cell_skills:NODES"])
def test_an_installed_plug_in_needs_no_word_in_the_mission(site: Path, value: str) -> None:
    install(site, WAVE, value)
    read = without_plugins("{Main: Wave}")
    (source,) = read.sources
    assert (source.name, source.file, source.distribution) == (
        "cell_skills", site / "cell_skills.py", "my-cell 1.2",
    )  # fmt: skip
    assert without_plugins("{Main: AlwaysSuccess}").sources == ()
    assert plugin_versions(read) == {"my-cell": "1.2"}
    module = list(mission_files(read))[-1]
    assert (module.name, module.content) == ("module/cell_skills.py", WAVE.encode())


def test_a_plug_in_that_is_installed_later_is_found(site: Path) -> None:
    assert NodeRegistry().find("Wave") is None
    install(site, WAVE)
    assert NodeRegistry().find("Wave") is not None


def test_an_installed_plug_in_that_fails_is_named_only_where_a_node_is_missed(site: Path) -> None:
    install(site, "1/0\n")
    assert check("trees: {Main: AlwaysSuccess}") == []
    assert check("trees: {Main: OpenGripper}") == []
    assert check("trees: {Main: OpnGripper}") == [
        "m.yaml:3:15: Main: unknown node 'OpnGripper' (did you mean 'OpenGripper'?)"
    ]
    assert check("trees: {Main: Zzz}") == [
        "m.yaml:3:15: Main: unknown node 'Zzz' (the plug-in 'cell_skills' cannot be imported: "
        "ZeroDivisionError: division by zero)"
        + below(
            f"""
            Traceback (most recent call last):
              File "{site}/cell_skills.py", line 1, in <module>
                1/0
                ~^~
            ZeroDivisionError: division by zero
            """
        )
    ]
    (problem,) = NodeRegistry().problems
    assert problem.plugin == "a_cell (cell_skills)"


def test_an_installed_plug_in_cannot_take_the_place_of_ours(site: Path) -> None:
    install(site, WAVE.replace("Wave(", "Grasp(").replace("(Wave", "(Grasp"))
    found = NodeRegistry().find("Grasp")
    assert found is not None and found.__module__ == "picktree.skills.grasp"
    assert check("trees: {Main: Zzz}") == [
        "m.yaml:3:15: Main: unknown node 'Zzz' (the plug-in 'cell_skills': the node 'Grasp' is already "
        "offered by picktree.skills)"
    ]

"""`include:`: trees of other files, where those may stand, and faults with the place in their own file."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from picktree.files import FileError
from picktree.files.yaml import read_document
from picktree.trees import Mission, RecordedFiles
from picktree.trees.loading import examine, load_mission, parse_mission, read_mission
from picktree.trees.loading.loader import MAX_INCLUDED_FILES

from .scripted import registry

HEAD = "picktree: 1\nkind: mission\n"
LIBRARY = "library: true\n"
LOOK = LIBRARY + "trees: {Look: {Take: {object: a}}}\n"


def write(folder: Path, **texts: str) -> Path:
    """Mission files by their stems; the first is the mission."""
    for stem, text in texts.items():
        path = folder / f"{stem.replace('__', '/')}.yaml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(HEAD + dedent(text).lstrip("\n"))
    return folder / f"{next(iter(texts))}.yaml"


def load(folder: Path, **texts: str) -> Mission:
    return load_mission(write(folder, **texts), registry())


def faults(folder: Path, **texts: str) -> list[str]:
    with pytest.raises(FileError) as caught:
        load(folder, **texts)
    return [f"{fault.code} {str(fault).removeprefix(f'{folder}/')}" for fault in caught.value.faults]


def test_trees_of_other_files_join_those_of_the_mission(tmp_path: Path) -> None:
    mission = load(
        tmp_path,
        m="include: [parts/look.yaml, common.yaml]\ntrees: {Main: {Sequence: [Look, Put, Rest]}}",
        parts__look="library: true\ninclude: [rest.yaml, ../common.yaml]\ntrees: {Look: Rest}",
        parts__rest="library: true\ntrees: {Rest: AlwaysSuccess}",
        common="library: true\ntrees: {Put: {ports: {n: {type: int, default: 1}}, AlwaysSuccess: {}}}",
    )
    assert list(mission.trees) == ["Main", "Look", "Rest", "Put"]
    assert [str(d.path.relative_to(tmp_path)) for d in mission.included] == [
        "parts/look.yaml",
        "parts/rest.yaml",
        "common.yaml",
    ]
    assert mission.trees["Rest"].mark.file == f"{tmp_path}/parts/rest.yaml"
    assert list(mission.files) == ["parts/look.yaml", "parts/rest.yaml", "common.yaml"]


def test_faults_of_all_files_come_at_once_each_with_its_place(tmp_path: Path) -> None:
    assert faults(
        tmp_path,
        m="include: [a.yaml, b.yaml]\ntrees: {Main: {Sequence: [Look, Lok]}}",
        a="library: true\ntrees: {Look: {Take: {objct: a, object: b}}}",
        b="library: true\nscene: three_bins\ntrees: {Main: AlwaysSuccess, Put: Tke}",
    ) == [
        "P218 a.yaml:4:23: Look/Take: Take has no port 'objct' (did you mean 'object'?)",
        "P248 b.yaml:4:1: scene: a library has no 'scene': only a mission sets it",
        "P248 b.yaml:5:9: trees.Main: a library has no tree 'Main': that is the mission's",
        f"P247 b.yaml:5:9: trees.Main: the tree 'Main' is given twice (first on line 4 of {tmp_path}/m.yaml)",
        "P207 b.yaml:5:35: Put: unknown node 'Tke' (did you mean 'Take'?)",
        "P207 m.yaml:4:33: Main/Sequence: unknown node 'Lok' (did you mean 'Look'?)",
    ]


def test_a_tree_that_is_given_twice(tmp_path: Path) -> None:
    assert faults(
        tmp_path,
        m="include: [a.yaml, b.yaml]\ntrees: {Main: Look}",
        a=LOOK,
        b=LOOK,
    ) == [
        f"P247 b.yaml:4:9: trees.Look: the tree 'Look' is given twice (first on line 4 of {tmp_path}/a.yaml)"
    ]


@pytest.mark.parametrize(
    ("include", "fault"),
    [
        ("a.yaml", "P242 m.yaml:3:10: include: 'include' is a list of files beside the mission and of the "
         "library (as '[common.yaml, library/recovery]')"),
        ("[3]", "P242 an included file is named by a text (as 'common.yaml' or 'library/recovery')"),
        ("[b.yaml]", "P243 there is no file 'b.yaml' beside the mission"),
        ("[common]",
         "P242 'common' is not a YAML file ('common.yaml', or 'library/common' for a file of the library)"),
        ("[library/recovry]", "P243 the library has no 'recovry' (did you mean 'recovery'?)"),
        ("[library/../m.yaml]", "P243 the files include each other in a circle: m.yaml → m.yaml"),
        ("[library/a/b]", "P243 the library has no 'library/a/b'"),
        ("[/etc/passwd]",
         "P243 '/etc/passwd' is not a path below the mission's folder (as 'common.yaml' or "
         "'parts/bins.yaml')"),
        ("['C:\\a.yaml']", "P243 'C:\\\\a.yaml' is not a path below the mission's folder (as 'common.yaml' "
        "or "
         "'parts/bins.yaml')"),
        ("[../a.yaml]", "P243 '../a.yaml' lies outside of the mission's folder"),
        ("[a/../../a.yaml]", "P243 'a/../../a.yaml' lies outside of the mission's folder"),
        ("[plain.yaml]", "P243 'plain.yaml' is not meant for inclusion (a file to include needs "
         "'library: true' at the top, and no tree 'Main')"),
        ("[one.yaml]", "P243 two.yaml:4:11: include[0]: the files include each other in a circle: one.yaml "
         "→ two.yaml → one.yaml"),
        ("[broken.yaml]", "P101 broken.yaml:4:1: not valid YAML: a value is missing here"),
    ],
)  # fmt: skip
def test_what_may_not_be_included(tmp_path: Path, include: str, fault: str) -> None:
    found = faults(
        tmp_path,
        m=f"include: {include}\ntrees: {{Main: AlwaysSuccess}}",
        plain="trees: {Main: AlwaysSuccess}",
        one="library: true\ninclude: [two.yaml]\ntrees: {One: AlwaysSuccess}",
        two="library: true\ninclude: [one.yaml]\ntrees: {Two: AlwaysSuccess}",
        broken="a: [",
    )
    assert [each.replace("m.yaml:3:11: include[0]: ", "", 1) for each in found] == [fault]


def test_a_symbolic_link_does_not_lead_out(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.yaml").write_text(HEAD + LOOK)
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "look.yaml").symlink_to(tmp_path / "elsewhere.yaml")
    assert faults(inside, m="include: [look.yaml]\ntrees: {Main: AlwaysSuccess}") == [
        "P243 m.yaml:3:11: include[0]: 'look.yaml' leads out of the mission's folder by a symbolic link"
    ]
    (inside / "look.yaml").unlink()
    (inside / "look.yaml").symlink_to("look.yaml")
    assert faults(inside, m="include: [look.yaml]\ntrees: {Main: AlwaysSuccess}") == [
        "P243 m.yaml:3:11: include[0]: there is no file 'look.yaml' beside the mission"
    ]


def test_the_number_of_files_is_bounded(tmp_path: Path) -> None:
    chain = {
        f"n{n}": f"library: true\ninclude: [n{n + 1}.yaml]\ntrees: {{N{n}: AlwaysSuccess}}"
        for n in range(MAX_INCLUDED_FILES + 1)
    }
    (fault,) = faults(tmp_path, m="include: [n0.yaml]\ntrees: {Main: AlwaysSuccess}", **chain)
    assert (
        fault == f"P243 n{MAX_INCLUDED_FILES - 1}.yaml:4:11: include[0]: a mission includes at most 50 files"
    )


def test_a_library_cannot_be_run_but_looked_at(tmp_path: Path) -> None:
    path = write(tmp_path, look=LOOK)
    document = read_document(path, "mission")
    assert examine(document, registry()).faults == ()
    with pytest.raises(FileError) as caught:
        read_mission(document, registry())
    assert str(caught.value) == (
        f"{path}:3:10: library: this file is for inclusion: it has no tree 'Main' to begin with"
    )


def test_included_files_can_come_from_a_record(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        m="include: [parts/look.yaml, library/recovery]\ntrees: {Main: Look}",
        parts__look="library: true\ninclude: [rest.yaml]\ntrees: {Look: Rest}",
        parts__rest="library: true\ntrees: {Rest: AlwaysSuccess}",
    )
    recorded = load_mission(path)
    texts = recorded.files
    assert list(texts) == ["parts/look.yaml", "parts/rest.yaml", "library/recovery"]
    nowhere = Path("/nowhere/m.yaml")
    again = parse_mission(recorded.text, nowhere, None, RecordedFiles(texts, nowhere.parent))
    assert list(again.trees) == list(recorded.trees)
    assert again.files == texts
    with pytest.raises(FileError) as caught:
        parse_mission(recorded.text, nowhere, None, RecordedFiles({}, nowhere.parent))
    assert [fault.message for fault in caught.value.faults][:2] == [
        "the record holds no file 'parts/look.yaml'",
        "the record holds no file 'library/recovery'",
    ]


def test_trees_of_a_file_that_is_not_there_are_not_missed_one_by_one(tmp_path: Path) -> None:
    assert faults(tmp_path, m="include: [looks.yaml]\ntrees: {Main: {Sequence: [Glance, Peer, Tke]}}") == [
        "P243 m.yaml:3:11: include[0]: there is no file 'looks.yaml' beside the mission",
        "P207 m.yaml:4:41: Main/Sequence: unknown node 'Tke' (did you mean 'Take'?)",
    ]

"""Files that were made to blow up, and files that are none: refused at a place, with bounded means."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from picktree.apps.cli.file_schemas import CHECKS
from picktree.files.file_checks import check_files

HEAD = "picktree: 1\nkind: {}\n"
SCENE = HEAD.format("scene") + "robot: panda\n"
MISSION = HEAD.format("mission") + "trees:\n"
LONG_RULE = " or ".join(["kind == 'a'"] * 60)

HOSTILE = {
    "nested_10_mb": (SCENE + "a: " + "[" * 10_000_000, "P123 1:1"),
    "nested": (SCENE + "a: " + "[" * 900_000, "P123 4:203"),
    "nested_mappings": (SCENE + "a: " + "{a: " * 200_000, "P123 4:800"),
    "nested_blocks": (SCENE + "".join(" " * n + "a:\n" for n in range(1300)), "P123 204:201"),
    "bomb": (
        SCENE
        + "a: &a [x, x, x, x, x, x, x, x, x, x]\n"
        + "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in pairwise("abcdefgh")),
        "P123 8:20",
    ),
    "values": (SCENE + "spawn: [" + "1," * 100_000 + "]\n", "P123 4:99991"),
    "wrong_entries": (SCENE + "spawn: [" + "1," * 40_000 + "]\n", "P110 4:1"),
    "wrong_keys": (SCENE + "".join(f"key_{n}: 1\n" for n in range(24_000)), "P104 4:1"),
    "wrong_kinds": (
        SCENE + "catalogue:\n" + "".join(f"  k{n}: {{mas: 1}}\n" for n in range(199)), "P105 5:3"
    ),
    "rules": (
        SCENE
        + "fixtures: {b: {bin: [1, 1, 1], wall: 1 cm, at: [0, 0, 0]}}\ncatalogue:\n"
        + "".join(f"  k{n}: {{sphere: {{radius: 2 cm}}, mass: 1, friction: 1}}\n" for n in range(200))
        + "destinations:\n"
        + f"  - {{where: \"{LONG_RULE}\", to: b}}\n" * 200,
        "P417 207:22",
    ),
    "twice": (SCENE + "goal: left == 0\n" * 20_000, "P114 5:1"),
    "tags": (SCENE + "spawn: [" + "!!x 1," * 40_000 + "]\n", "P116 4:9"),
    "python": (SCENE + "goal: !!python/object/apply:os.system [touch pwned]\n", "P116 4:7"),
    "comments": (SCENE + "# picktree: allow P104\n" * 20_000, "P130 4:1"),
    "long_key": (SCENE + '"' + "k" * 1000 + '": 1\n', "P104 4:1"),
    "long_number": (SCENE + "checkpoint_every: " + "9" * 5000 + "\n", "P120 4:19"),
    "infinite": (SCENE + "limits: {force: 1e400}\n", "P120 4:17"),
    "mission_deep": (MISSION + "  Main: " + "{Inverter: " * 190 + "AlwaysSuccess" + "}" * 190, "P236 4:3"),
    "mission_wide": (MISSION + "  Main:\n    Sequence:\n" + "      - Nope\n" * 9_000, "P207 6:9"),
    "mission_doubling": (
        MISSION
        + "  Main: T0\n"
        + "".join(f"  T{n}: {{Sequence: [T{n + 1}, T{n + 1}]}}\n" for n in range(60))
        + "  T60: AlwaysSuccess\n",
        "P236 4:3",
    ),
    "poses": (
        HEAD.format("robot")
        + "urdf: pybullet_data:franka_panda/panda.urdf\nposes:\n"
        + "".join(f"  p{n}: [1, 2]\n" for n in range(8_000)),
        "P105 1:1",
    ),
    "faults": (
        HEAD.format("faults") + "faults:\n" + "  - {fault: remov, when: {at: 1}, target: {index: 1}}\n" * 900,
        "P108 4:13",
    ),
    "null_bytes": (b"\0" * 900_000, "P121 1:1"),
    "noise": (bytes(range(128, 256)) * 2000, "P122 1:1"),
    "utf_16": (SCENE.encode("utf-16"), "P122 1:1"),
    "utf_16_without_mark": (SCENE.encode("utf-16-le"), "P122 1:1"),
    "utf_32": (SCENE.encode("utf-32"), "P122 1:1"),
    "latin_1": ((SCENE + "# café\n").encode("latin-1"), "P122 4:6"),
    "carriage_returns": (SCENE.replace("\n", "\r"), "P121 1:12"),
    "next_line": (SCENE + "# \x85\n", "P121 4:3"),
    "mark_within": (SCENE + "goal: \ufeffleft == 0\n", "P121 4:7"),
}  # fmt: skip


@pytest.fixture(scope="module")
def refused(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The first fault of each hostile file, of one process that may use little time and memory for all."""
    folder = tmp_path_factory.mktemp("hostile")
    for name, (text, _) in HOSTILE.items():
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
        resource.setrlimit(resource.RLIMIT_AS, (3_000_000_000, 3_000_000_000))

    command = [sys.executable, "-m", "picktree", "check", "--format", "json", *sorted(HOSTILE)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each thread reserves memory
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, preexec_fn=limit
    )
    assert (done.returncode, done.stderr) == (2, "")
    assert not (folder / "pwned").exists()
    first: dict[str, str] = {}
    for fault in json.loads(done.stdout)["faults"]:
        first.setdefault(fault["file"], f"{fault['code']} {fault['line']}:{fault['column']}")
    return first


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_at_a_place(name: str, refused: dict[str, str]) -> None:
    assert refused[name] == HOSTILE[name][1]


def said_of(path: Path) -> str:
    (fault,) = check_files([path], CHECKS).faults
    return f"{fault.code} {fault.message}"


def test_what_is_no_file_is_neither_opened_nor_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    (tmp_path / "zero.yaml").symlink_to("/dev/zero")
    (tmp_path / "gone.yaml").symlink_to("nothing.yaml")
    assert said_of(tmp_path / "pipe.yaml") == "P124 this is a pipe, not a file"
    assert said_of(tmp_path / "zero.yaml") == "P124 this is a device, not a file"
    assert said_of(tmp_path / "gone.yaml") == "P124 there is no such file"
    assert said_of(tmp_path / "pipe.yaml" / "x.yaml") == "P124 there is no such file"
    assert said_of(tmp_path / "loop.yaml") == (
        "P124 the file cannot be read: too many levels of symbolic links"
    )
    assert said_of(Path("a\0b.yaml")) == "P124 this is no path: it holds a null character"
    assert said_of(tmp_path / ("n" * 300)) == "P124 the file cannot be read: file name too long"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").touch(mode=0)
    assert said_of(tmp_path / "mine.yaml") == "P124 the file cannot be read: permission denied"


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder with pipes, and files that are too large or no meshes."""
    for name in ("pipe.yaml", "pipe.stl", "pipe.urdf"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "large.obj").write_bytes(b"#" * 1_000_001)
    (tmp_path / "large.urdf").write_bytes(b" " * 5_000_001)
    (tmp_path / "noise.stl").write_bytes(bytes(range(256)) * 4)
    return tmp_path


def nut(mesh: str) -> str:
    return f"robot: panda\ncatalogue: {{nut: {{mesh: {mesh}, mass: 1, friction: 1}}}}"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robot: /dev/zero/x.yaml", "P401 there is no robot file /dev/zero/x.yaml"),
        ("robot: pipe.yaml", "P401 there is no robot file {here}/pipe.yaml"),
        ('robot: "a\\0.yaml"', "P401 'a\\x00.yaml' is not the name of a robot"),
        ("base: pipe.yaml", "P402 there is no scene file {here}/pipe.yaml"),
        (nut("pipe.stl"), "P409 {here}/pipe.stl: this is a pipe, not a file"),
        (nut("/etc/passwd"), "P409 passwd is not a mesh file of a known format"),
        (nut("large.obj"), "P409 {here}/large.obj: the file is larger than 1 MB"),
        (nut("noise.stl"), "P409 the mesh file is damaged, or of another format than its name says"),
    ],
)
def test_files_that_a_scene_names(text: str, said: str, here: Path) -> None:
    (here / "scene.yaml").write_text(HEAD.format("scene") + text + "\n")
    assert said_of(here / "scene.yaml") == said.format(here=here)


@pytest.mark.parametrize(
    ("urdf", "said"),
    [
        ("pipe.urdf", "P501 there is no file {here}/pipe.urdf"),
        (
            "pybullet_data:../pip/__init__.py",
            "P501 '../pip/__init__.py' is outside of the package 'pybullet_data'",
        ),
        ("large.urdf", "P502 {here}/large.urdf: the file is larger than 5 MB"),
        (
            "bomb.urdf",
            "P502 {here}/bomb.urdf: entities are not read, as <!ENTITY a>; "
            "`xmllint --noent FILE` writes a file without them",
        ),
        ("deep.urdf", "P502 {here}/deep.urdf: elements are more than 100 levels deep in each other"),
        ("page.urdf", "P502 {here}/page.urdf: the outermost element is <html>, not <robot>"),
    ],
)
def test_urdfs(urdf: str, said: str, here: Path) -> None:
    (here / "page.urdf").write_text("<html/>")
    (here / "deep.urdf").write_text("<robot>" * 300_000 + "</robot>" * 300_000)
    (here / "bomb.urdf").write_text(
        '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot>&b;</robot>'
    )
    (here / "robot.yaml").write_text(HEAD.format("robot") + f"urdf: {urdf}\n")
    found = [f for f in check_files([here / "robot.yaml"], CHECKS).faults if f.code.startswith("P5")]
    assert [f"{f.code} {f.message}" for f in found] == [said.format(here=here)]

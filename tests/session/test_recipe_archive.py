"""What is archived is what was read: each form in which a recipe can name a file comes back from its archive.

The forms are those of the grammars. A new one fails here until `SAMPLES` has it and the archive keeps it.
"""

from __future__ import annotations

import json
import types
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias, Union, get_args, get_origin

import pytest
from pydantic import BeforeValidator

from picktree.files.file_system import ROOT
from picktree.files.yaml import file_models
from picktree.files.yaml.file_models import NamedFile, ReadAs, ShortForm
from picktree.session import RunRequest
from picktree.session.run_recipe import Recipe, RecipeFile, read_recipe, recipe_files, write_recipe
from picktree.simulation.fault_entries import FaultsFile
from picktree.simulation.heap_spawning import mesh_files
from picktree.world.robot_model import link_shapes
from picktree.world.robot_model.robot_schema import RobotFile
from picktree.world.scene import SceneDescription, SceneFile

from ..robots.test_robot_file import ROBOT, URDF

MODELS: Mapping[str, type[file_models.AnyModel]] = {
    "scene": SceneFile,
    "robot": RobotFile,
    "faults": FaultsFile,
}
Form: TypeAlias = tuple[str, str]
"""Kind of a file, and place of a text in it as `catalogue.*.mesh`."""

CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 30) for y in (0, 30) for z in (0, 30)) + "".join(
    f"f {a} {b} {c}\n"
    for a, b, c in (
        (1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2),
        (3, 4, 8), (3, 8, 7), (1, 3, 7), (1, 7, 5), (2, 6, 8), (2, 8, 4),
    )
)  # fmt: skip
SMALLER = CUBE.replace("30", "20")
PAINTED = f"mtllib paint.mtl\nusemtl red\n{CUBE}"
METRES = CUBE.replace("30", "0.03")
PAINT = "newmtl red\nKd 0.8 0.1 0.1\n"
MISSION = """\
picktree: 1
kind: mission
name: look
scene: ../scene.yaml
include: [parts/look.yaml, library/recovery]
plugins: [plugins/wave.py]
trees:
  Main: {Sequence: [Look, Wave]}
"""
LOOK = "picktree: 1\nkind: mission\nlibrary: true\nplugins: [nod.py]\ntrees: {Look: Nod}\n"
WAVE = '''\
from picktree.trees import Skill, Steps
from picktree.robot import World


class Wave(Skill):
    """Waits."""

    def run(self, world: World) -> Steps:
        yield


NODES = (Wave,)
'''
HEAD = "picktree: 1\nkind: {}\n"
SCENE = HEAD.format("scene") + "base: sort_small\n"
FAULT = "{fault: friction, when: {at: 1 s}, target: {index: 1}, friction: 0.2}"
FILES: Mapping[str, str] = {
    "missions/look.yaml": MISSION,
    "missions/parts/look.yaml": LOOK,
    "missions/plugins/wave.py": WAVE,
    "missions/parts/nod.py": WAVE.replace("Wave", "Nod"),
    "parts/lump.obj": PAINTED,
    "parts/paint.mtl": PAINT,
    "others/lump.obj": SMALLER,
    "things/one.obj": f"o a\n{METRES}",
    "robots/arm.urdf": URDF,
    "robots/own.yaml": ROBOT,
}


def item(mesh: str, name: str = "lump") -> str:
    return f"  {name}: {{mesh: {mesh}, mass: 80 g, friction: 0.6}}\n"


def catalogue(*items: str) -> dict[str, str]:
    return {"scene.yaml": f"{SCENE}catalogue:\n{''.join(items)}"}


def faults(keys: str) -> str:
    return f"{HEAD.format('faults')}{keys}faults: [{FAULT}]\n"


def robot(urdf: str = URDF, flange: str = "wrist", more: str = "") -> dict[str, str]:
    """A scene with a robot of its own; `more`: further keys of its file."""
    text = f"{ROBOT.replace('flange_joint: wrist', f'flange_joint: {flange}')}{more}\n"
    scene = f"{SCENE}robot: robots/own.yaml\n"
    return {"scene.yaml": scene, "robots/own.yaml": text, "robots/arm.urdf": urdf}


def with_mesh(filename: str, *more: str) -> str:
    shapes = "".join(
        f'<visual><geometry><mesh filename="{name}" scale="0.001 0.001 0.001"/></geometry></visual>'
        for name in (filename, *more)
    )
    return URDF.replace('<link name="upper"/>', f'<link name="upper">{shapes}</link>')


HOOK = """\
<robot name="hook"><link name="hook"><visual><geometry>
<mesh filename="../parts/lump.obj" scale="0.001 0.001 0.001"/>
</geometry></visual></link></robot>
"""
LONG = "{file: parts/lump.obj, scale: 0.001}"
ABOVE = "{file: ../parts/lump.obj, scale: 0.001}"
ON_BASE = f"{HEAD.format('scene')}base: bases/own.yaml\n"
SAMPLES: Mapping[Form, Mapping[str, Mapping[str, str]]] = {
    ("scene", "base"): {
        "a file": {"scene.yaml": ON_BASE, "bases/own.yaml": f"{SCENE}catalogue:\n{item(ABOVE)}"},
        "which has the mesh, and this one its scale": {
            "scene.yaml": f"{ON_BASE}catalogue: {{lump: {{mesh: {{scale: 0.002}}}}}}\n",
            "bases/own.yaml": f"{SCENE}catalogue:\n{item(ABOVE)}",
        },
    },
    ("scene", "robot"): {"a file": robot()},
    ("scene", "assortment.meshes"): {
        "a folder": {"scene.yaml": f"{SCENE}assortment: {{meshes: things}}\n"},
        "a set": {"scene.yaml": f"{SCENE}assortment: {{meshes: random_urdfs}}\n"},
    },
    ("scene", "catalogue.*.mesh"): {
        "a bare text": catalogue(item("parts/small.obj")) | {"parts/small.obj": METRES}
    },
    ("scene", "catalogue.*.mesh.file"): {
        "below": catalogue(item(LONG)),
        "outside": {
            "cell/scene.yaml": f"{SCENE}catalogue:\n{item(ABOVE)}",
            "missions/look.yaml": MISSION.replace("../scene", "../cell/scene"),
        },
        "absolute": catalogue(item("{file: '{here}/parts/lump.obj', scale: 0.001}")),
        "twice, with two scales": catalogue(item(LONG), item("{file: parts/lump.obj, scale: 0.002}", "big")),
        "two of a name": catalogue(item(LONG), item("{file: others/lump.obj, scale: 0.001}", "other")),
    },
    ("robot", "urdf"): {
        "a file": robot(),
        "with meshes": robot(with_mesh("../parts/lump.obj", "../others/lump.obj")),
        "with a mesh twice": robot(with_mesh("../parts/lump.obj", "{here}/parts/lump.obj")),
        "with packages": robot(with_mesh("package://parts/lump.obj", "file://{here}/others/lump.obj")),
        "with attachments": robot(more="attachments: {upper: [{box: [0.1, 0.1, 0.1]}]}"),
        "with inertias": robot(
            more="inertias: {upper: {mass: 1, at: [0, 0, 0], moments: [0.01, 0.01, 0.01]}}"
        ),
        "without a flange": robot(flange="mounting", more="flange_behind: turn"),
    },
    ("robot", "mount.urdf"): {
        "a file": robot(more="mount: {urdf: ../grippers/hook.urdf, to: upper}") | {"grippers/hook.urdf": HOOK}
    },
    ("faults", "scene"): {
        "a file": {"scene.yaml": SCENE, "faults.yaml": faults("scene: scene.yaml\n")},
        "none": {"scene.yaml": SCENE, "faults.yaml": faults("")},
    },
}
NO_FILES = {
    "scene": """calibration.by calibration.date destinations.*.to destinations.*.where feed.*.belt
        feed.*.colours.* feed.*.into fixtures.*.colour goal planner spawn.*.colours.* spawn.*.into
        unknown.*.colour""",
    "robot": """disabled_pairs.*.* flange_behind flange_joint gripper.joints.* gripper.linkage.drive
        gripper.links.* mount.joint mount.link mount.prefix mount.to planner tcp.link""",
    "faults": """expect.causes.* expect.roots.* faults.*.body.colour faults.*.camera faults.*.colour
        faults.*.joint faults.*.kind faults.*.name faults.*.shown_as faults.*.target.colour
        faults.*.target.kind faults.*.when.node""",
}
"""Texts of the grammars that name no file."""


def texts(
    kind: Any, loc: str = "", marks: tuple[object, ...] = (), above: tuple[object, ...] = ()
) -> Iterator[tuple[str, bool]]:
    """Yield the place of each free text of a grammar, and whether it is marked as the name of a file."""
    kind = getattr(kind, "__supertype__", kind)
    origin = get_origin(kind)
    if origin is Annotated:
        kind, *more = get_args(kind)
        kind = next((mark.form for mark in more if isinstance(mark, ReadAs)), kind)
        yield from texts(kind, loc, (*marks, *more), above)
    elif origin in (Union, types.UnionType):
        for part in get_args(kind):
            yield from texts(part, loc, marks, above)
    elif origin in (dict, list, tuple):
        for part in get_args(kind)[1:] if origin is dict else get_args(kind):
            if part is not Ellipsis:
                yield from texts(part, f"{loc}.*".lstrip("."), (), above)
    elif file_models.is_model(kind) and kind not in above:
        short = [mark.key for mark in marks if isinstance(mark, ShortForm)]
        for name, field in file_models.model_fields(kind).items():
            inner = file_models.declared_type(field)
            yield from texts(inner, f"{loc}.{field.alias or name}".lstrip("."), (), (*above, kind))
            if name in short:
                yield from texts(inner, loc, (), (*above, kind))
    elif kind is str and not any(isinstance(mark, BeforeValidator) for mark in marks):
        yield loc, any(isinstance(mark, NamedFile) for mark in marks)


def forms(named: bool) -> set[Form]:
    return {(kind, loc) for kind, model in MODELS.items() for loc, mark in texts(model) if mark is named}


def test_each_form_in_which_a_recipe_names_a_file_has_a_sample() -> None:
    assert forms(named=True) == SAMPLES.keys()


def test_each_other_text_is_known_to_name_no_file() -> None:
    assert forms(named=False) == {(kind, loc) for kind, known in NO_FILES.items() for loc in known.split()}


def test_a_mission_names_files_by_three_keys() -> None:
    """`scene`, `include` and `plugins`, which the sample mission has; a new key is to be judged here."""
    known = {"picktree", "kind", "name", "scene", "goal", "library", "include", "plugins", "trees"}
    schema = json.loads((ROOT / "schemas" / "mission.json").read_text())
    assert set(schema["properties"]) == known


CASES = [
    pytest.param(files, id=f"{kind} {loc}: {case}")
    for (kind, loc), cases in SAMPLES.items()
    for case, files in cases.items()
]


@pytest.mark.parametrize("files", CASES)
def test_an_archive_gives_back_what_was_read(files: Mapping[str, str], tmp_path: Path) -> None:
    here = tmp_path / "here"
    for name, text in {**FILES, **files}.items():
        (here / name).parent.mkdir(parents=True, exist_ok=True)
        (here / name).write_text(text.replace("{here}", str(here)))
    planted = here / "faults.yaml"
    request = RunRequest(here / "missions/look.yaml", faults=planted if planted.exists() else None)
    recipe = read_recipe(request)
    attached, shapes, things = contents(recipe), link_shapes(recipe.robot.urdf), assorted(recipe)
    write_recipe(recipe, tmp_path / "recipe.zip")
    here.rename(tmp_path / "gone")
    with RecipeFile(tmp_path / "recipe.zip") as archive:
        again = archive.recipe(0)
        assert placeless(again.scene) == placeless(recipe.scene)
        assert link_shapes(again.robot.urdf) == shapes
        assert list(again.mission.trees) == list(recipe.mission.trees)
        assert contents(again) == attached
        assert assorted(again) == things


def placeless(scene: SceneDescription) -> SceneDescription:
    return replace(scene, source="", robot="", assortment=None)


def contents(recipe: Recipe) -> dict[str, bytes]:
    """Everything that an archive of the recipe holds, but the URDF, whose meshes have other places there."""
    return {file.name: file.data for file in recipe_files(recipe) if file.name != "robot.urdf"}


def assorted(recipe: Recipe) -> list[bytes]:
    """The content of the meshes of the scene's assortment."""
    entry = recipe.scene.assortment
    return [Path(file).read_bytes() for file in mesh_files(entry.meshes)[:3]] if entry else []

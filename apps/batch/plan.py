"""Plan of a batch: a matrix of missions, scenes, faults and settings, each with many seeds; grammar and
loader of plan files.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, cast, get_type_hints

from pydantic import BeforeValidator, Field, Strict, TypeAdapter, ValidationError, WithJsonSchema

from picktree.authoring import MissionCheck, check_mission
from picktree.files import (
    CheckedFile,
    Diagnostic,
    FileError,
    PicktreeError,
    describe,
    file_system,
    suggest_name,
)
from picktree.files.yaml import Document, DocumentChecker, file_models, read_document
from picktree.session import RunRequest, run_recipe
from picktree.simulation import Backend, load_faults
from picktree.trees import read_settings
from picktree.trees.loading import SceneNames, load_surroundings
from picktree.world.robot_model import robot_file
from picktree.world.scene import scene_loading

if TYPE_CHECKING:
    from picktree.authoring.schema import Schema

Keep: TypeAlias = Literal["all", "failures", "none"]
"""Logs that are kept."""


Question: TypeAlias = Literal["goal", "units"]
"""Comparison by the share of goals reached, or by the units an hour of each seed."""
DEFAULT_MARGIN = 0.1
"""Difference within which two recipes count as equal, 0 … 1."""


@dataclass(frozen=True, slots=True)
class Variant:
    """One cell of the matrix, without a seed."""

    mission: Path
    scene: str | None
    """Scene that replaces the mission's; the path of a file is absolute. None: the mission's own."""
    faults: Path | None
    settings: Mapping[str, str]
    label: str
    """Properties that distinguish this variant from the others of its plan."""
    robot: str | None = None
    """Robot that replaces the scene's; the path of a file is absolute. None: the scene's own."""


MOST_SEEDS = 100_000
LARGEST_SEED = 2**31 - 1
_EXAMPLE = "write 0:100 (half open), 3,7 or both"


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds in the order of the text, each once. Raises PicktreeError.

    >>> parse_seeds("0:3,7")
    (0, 1, 2, 7)
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        first, colon, last = part.strip().partition(":")
        try:
            start = int(first)
            stop = int(last) if colon else start + 1
        except ValueError:
            raise PicktreeError(f"seeds {text!r}: {part.strip()!r} is not a seed; {_EXAMPLE}") from None
        if start < 0 or stop - 1 > LARGEST_SEED:
            raise PicktreeError(f"seeds {text!r}: a seed is 0 or more, and at most {LARGEST_SEED}")
        if stop <= start:
            raise PicktreeError(f"seeds {text!r}: the range {part.strip()!r} is empty: {_EXAMPLE}")
        if len(seeds) + stop - start > MOST_SEEDS:
            raise PicktreeError(f"seeds {text!r}: more than {MOST_SEEDS} seeds")
        seeds.update(dict.fromkeys(range(start, stop)))
    return tuple(seeds)


_BYTES = {"MB": 10**6, "GB": 10**9, "MiB": 2**20, "GiB": 2**30}
NO_FAULTS = "none"
"""Entry in the list of faults files: a run without faults."""


def _seeds(value: object) -> tuple[int, ...]:
    parts: list[object] = cast("list[object]", value) if isinstance(value, list) else [value]
    if not parts or any(isinstance(part, bool) or not isinstance(part, int | str) for part in parts):
        raise file_models.InvalidValue(
            f"{describe(cast('object', value))} is not a list of seeds",
            "as 0:100 (half open) or [3, 7]",
            code="P801",
        )
    try:
        return parse_seeds(",".join(map(str, parts)))
    except PicktreeError as error:
        raise file_models.InvalidValue(str(error), code="P801") from None


def _bytes(value: object, of: str) -> int:
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([A-Za-z]+)\s*", value) if isinstance(value, str) else None
    if match is None or match[2] not in _BYTES:
        raise file_models.InvalidValue(f"{describe(value)} is not an amount of {of}", "as 2 GB", code="P801")
    return round(float(match[1]) * _BYTES[match[2]])


def _setting(value: object) -> str:
    if not isinstance(value, str | int | float):
        raise file_models.InvalidValue(
            f"{describe(value)} cannot be the value of a port", "a text, a number, true or false", code="P801"
        )
    return str(value).lower() if isinstance(value, bool) else str(value)


Text = Annotated[str, Strict(), Field(min_length=1)]
SettingValue = Annotated[
    str, BeforeValidator(_setting), WithJsonSchema({"type": ["string", "number", "boolean"]})
]
Seeds = Annotated[
    tuple[int, ...],
    BeforeValidator(_seeds),
    WithJsonSchema(
        {
            "type": ["string", "integer", "array"],
            "items": {"type": ["integer", "string"]},
            "examples": ["0:100"],
        }
    ),
]
Memory = Annotated[
    int,
    BeforeValidator(partial(_bytes, of="memory")),
    WithJsonSchema({"type": "string", "examples": ["2 GB"]}),
]
Disk = Annotated[
    int, BeforeValidator(partial(_bytes, of="disk")), WithJsonSchema({"type": "string", "examples": ["2 GB"]})
]
Seconds = Annotated[float, file_models.quantity("s", above=0)]


def _faults(name: str) -> Path | None:
    return None if name == NO_FAULTS else Path(name)


def _settings(given: dict[str, str | list[str]]) -> dict[str, tuple[str, ...]]:
    return {key: tuple(values) if isinstance(values, list) else (values,) for key, values in given.items()}


def _own() -> tuple[None]:
    return (None,)


MissionPath = Annotated[Path, file_models.ReadAs(Text, Path)]
Replacement = Annotated[str | None, file_models.ReadAs(Text, str)]
"""Shipped name or path of a scene or robot. None: the mission's own scene, the scene's own robot."""
FaultsPath = Annotated[Path | None, file_models.ReadAs(Text, _faults)]


@dataclass(frozen=True, slots=True)
class BatchPlan(file_models.FileValue):
    """Batch of runs: every combination of missions, scenes, faults and settings, with each seed."""

    name: Annotated[str, file_models.ReadAs(Text | None, lambda name: name or ""), Field(default_factory=str)]
    """Name of the batch. Default: the file's name."""
    missions: Annotated[tuple[MissionPath, ...], Field(min_length=1)]
    """Mission files; paths count from this file."""
    seeds: Seeds
    """Seeds of the jobs: 0:100 (100 not included), 3,7, or a list of both."""
    scenes: tuple[Replacement, ...] = field(default_factory=_own)
    """Shipped scenes or scene files, each instead of the missions' own."""
    robots: tuple[Replacement, ...] = field(default_factory=_own)
    """Shipped robots or robot files, each instead of the scenes' own."""
    faults: tuple[FaultsPath, ...] = field(default_factory=_own)
    """Faults files; 'none' is a run without faults."""
    settings: Annotated[
        dict[str, tuple[str, ...]],
        file_models.ReadAs(dict[str, SettingValue | list[SettingValue]], _settings),
        Field(alias="set"),
    ] = field(default_factory=dict[str, "tuple[str, ...]"])
    """Values to be tried, by parameter of the mission or port of its nodes (SortOne/Grasp.force)."""
    backend: Backend = "physics"
    """kinematic: objects follow the gripper, sensors have no noise."""
    verify: file_models.Flag = False
    """Judge every trajectory by the second collision checker."""
    limit: Seconds = 3600.0
    """Simulated time after which the run of a job is ended."""
    wall_limit: Seconds = 3600.0
    """Wall time after which a job is ended."""
    memory: Memory = 4 * 10**9
    """Memory above which a job is ended, as 2 GB."""
    disk: Disk = 10 * 10**9
    """Amount of written data above which a job is ended, as 2 GB."""
    keep: Keep = "failures"
    """Jobs whose logs stay on the disk."""
    until: Literal["all", "decided"] = "all"
    """End of the batch: all jobs were run, or the recipes are distinguished."""
    by: Question = "goal"
    """Question that decides: goals reached, or units an hour."""
    margin: Annotated[float, file_models.quantity("", above=0, most=1)] = DEFAULT_MARGIN
    """Difference within which recipes count as equal: in the share of goals, or of seeds with more units."""

    @property
    def recipes(self) -> int:
        """Number of combinations without the seed."""
        lists = (self.missions, self.scenes, self.robots, self.faults, *self.settings.values())
        return math.prod(map(len, lists))

    def variants(self) -> Iterator[Variant]:
        """Yield every combination; the last list changes fastest."""
        names = list(self.settings)
        for mission, scene, robot, faults in product(self.missions, self.scenes, self.robots, self.faults):
            for values in product(*self.settings.values()):
                settings = dict(zip(names, values, strict=True))
                variant = Variant(mission, scene, faults, settings, "", robot)
                yield replace(variant, label=self._label(variant))

    def _label(self, variant: Variant) -> str:
        parts: list[tuple[Collection[object], str]] = [
            (self.missions, variant.mission.stem),
            (self.scenes, Path(variant.scene).stem if variant.scene else "own scene"),
            (self.robots, Path(variant.robot).stem if variant.robot else "own robot"),
            (self.faults, variant.faults.stem if variant.faults else "no faults"),
            *((self.settings[name], f"{name}={value}") for name, value in variant.settings.items()),
        ]
        words = [word for values, word in parts if len(values) > 1]
        return ", ".join(words) or variant.mission.stem


_ONE_RECIPE = "the plan has one recipe, and nothing to decide"
_MORE_RECIPES = "give a setting, scene or mission at least two values"
RECIPES = "recipes"
"""Folder of a batch with the recipes of its jobs, one for each variant."""


@dataclass(frozen=True, slots=True)
class Job:
    """Unit of work of one worker."""

    id: str
    """Hash over the content of the job's files, its settings, its seed and its options."""
    number: int
    """Index in the plan, from 0."""
    variant: Variant
    seed: int
    recipe: str
    """Hash over the same without the seed; it names the recipe's file."""

    def recipe_in(self, folder: Path) -> Path:
        """Return the recipe's file in the batch's `folder`."""
        return folder / RECIPES / f"{self.recipe}.zip"


def jobs_of(plan: BatchPlan, folder: Path) -> tuple[Job, ...]:
    """Return every job of a checked plan, by variant, then seed; write their recipes into `folder`.

    Raises FileError for a file that was edited since the check, PicktreeError when a recipe cannot be
    written.
    """
    jobs: list[Job] = []
    for variant in plan.variants():
        recipe = run_recipe.read_recipe(_request(plan, variant))
        content = _content(variant, recipe)
        for seed in plan.seeds:
            id_ = hashlib.sha256(f"{content} seed {seed}".encode()).hexdigest()[:16]
            jobs.append(Job(id_, len(jobs), variant, seed, content[:16]))
        run_recipe.write_recipe(recipe, jobs[-1].recipe_in(folder))
    return tuple(jobs)


def _content(variant: Variant, recipe: run_recipe.Recipe) -> str:
    """Return a fingerprint of everything but the seed on which the outcome depends."""
    said = {
        "settings": dict(variant.settings),
        "backend": recipe.backend,
        "verify": recipe.verify,
        "limit": recipe.limit,
        "files": {
            file.name: hashlib.sha256(file.data).hexdigest() for file in run_recipe.recipe_files(recipe)
        },
        "robot": {
            name: word.partition(" ")[0] for name, word in run_recipe.installed_meshes(recipe.robot).items()
        },
    }
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def _request(plan: BatchPlan, variant: Variant) -> RunRequest:
    return RunRequest(
        mission=variant.mission,
        scene=variant.scene,
        parameters=variant.settings,
        robot=variant.robot,
        faults=variant.faults,
        backend=plan.backend,
        verify=plan.verify,
        limit=plan.limit,
    )


PLAN_FILE = "plan.json"
_JOB_LIMITS = {"simulated": "limit", "wall": "wall_limit", "memory": "memory", "disk": "disk"}
"""Fields of a plan by the keys under `limits` of older records."""


def write_plan(plan: BatchPlan, folder: Path) -> None:
    """Write the plan. Raises PicktreeError when it cannot be written."""
    with file_system.whole([folder / PLAN_FILE], folder / PLAN_FILE) as (beside,):
        beside.write_text(json.dumps(asdict(plan), default=str, indent=1), "utf-8")


def read_plan(folder: Path) -> BatchPlan:
    """Read the plan of a batch. Raises PicktreeError when there is none."""
    try:
        return _recorded(json.loads((folder / PLAN_FILE).read_bytes()))
    except OSError:
        raise PicktreeError(f"{folder}: not a batch: there is no {PLAN_FILE} in this folder") from None
    except ValidationError as error:
        raise PicktreeError(
            f"{folder / PLAN_FILE}: not a valid plan of a batch: {error.errors()[0]['msg']}"
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise PicktreeError(f"{folder / PLAN_FILE}: not a valid plan of a batch") from None


def _recorded(fields: dict[str, Any]) -> BatchPlan:
    """Return the plan with these fields, as they are recorded."""
    fields |= {_JOB_LIMITS[key]: limit for key, limit in fields.pop("limits", {}).items()}
    kinds = get_type_hints(BatchPlan)
    return BatchPlan(**{key: TypeAdapter(kinds[key]).validate_python(fields[key]) for key in fields})


def plan_schema() -> Schema:
    """JSON Schema of plan files, for editors."""
    from picktree.authoring.schema import model_schema

    return model_schema("plan", BatchPlan)


def load_plan(path: Path) -> BatchPlan:
    """Load a plan. Raises FileError with all errors of the plan and of every file that it names."""
    return check_plan(read_document(path, "plan")).required()


def plan_of(words: Mapping[str, object]) -> BatchPlan:
    """Return the plan with these keys of a plan file; their paths are absolute, and scenes count from the
    working directory.

    Raises FileError with all errors of the named files, PicktreeError for an invalid key or setting.
    """
    given = {key: value for key, value in words.items() if value not in (None, [])}
    try:
        read = file_models.read_model(BatchPlan, given)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        option = str(detail["loc"][0]).replace("_", "-")
        raise PicktreeError(f"--{option}: {detail['msg'].removeprefix('Value error, ')}") from None
    plan = _resolved(read, read.missions[0], scenes_from=Path.cwd())
    faults = list(check_files_of(plan))
    if faults:
        raise FileError(faults)
    if plan.until == "decided" and plan.recipes < 2:
        raise PicktreeError(f"--until decided: {_ONE_RECIPE}: {_MORE_RECIPES}")
    for name in plan.settings:
        for message in _misfits(plan, name):
            raise PicktreeError(message)
    return plan


def check_plan(document: Document) -> CheckedFile[BatchPlan]:
    """Check a document of kind `plan` completely; never raises for its content."""
    check = DocumentChecker(document)
    read = check.read(BatchPlan)
    if check.faults:
        return CheckedFile(None, tuple(check.faults))
    plan = _resolved(read, document.path)
    for what, names, shipped in (
        ("scene", plan.scenes, scene_loading.scene_names()),
        ("robot", plan.robots, robot_file.robot_names()),
    ):
        for number, name in enumerate(names):
            if name is not None and name not in shipped and not file_system.is_file(Path(name)):
                hint = suggest_name(Path(name).name, shipped)
                check.fault((f"{what}s", number), f"there is no {what} file {name}", hint, code="P801")
    if plan.until == "decided" and plan.recipes < 2:
        check.fault(("until",), _ONE_RECIPE, _MORE_RECIPES, code="P801")
    if check.faults:
        return CheckedFile(None, tuple(check.faults))
    faults = list(check_files_of(plan))
    if not faults:
        for name in plan.settings:
            for message in _misfits(plan, name):
                check.fault(("set", name), message, code="P802", key=True)
    check.faults += faults
    return check.result(lambda: plan)


def check_files_of(plan: BatchPlan) -> Iterator[Diagnostic]:
    """Yield the errors in missions, scenes, robots and faults files that the plan names, each once."""
    seen: dict[Diagnostic, None] = {}
    for scene, robot, mission in product(plan.scenes, plan.robots, plan.missions):
        seen.update(dict.fromkeys(_faults_of_mission(mission, scene, robot)))
    for file in plan.faults:
        if file is not None:
            try:
                load_faults(file)
            except FileError as error:
                seen.update(dict.fromkeys(error.faults))
    yield from (fault for fault in seen if fault.severity == "error")


def _faults_of_mission(mission: Path, scene: str | None, robot: str | None) -> Iterable[Diagnostic]:
    try:
        return _checked(mission, scene, robot).faults
    except FileError as error:
        return error.faults


def _checked(mission: Path, scene: str | None, robot: str | None) -> MissionCheck:
    document = read_document(mission, "mission")
    known: SceneNames | None = load_surroundings(scene, robot=robot) if scene is not None else None
    return check_mission(document, known=known, robot=robot)


def _misfits(plan: BatchPlan, name: str) -> Iterator[str]:
    """Yield the error of a setting, for the first mission in which it is invalid."""
    for path in plan.missions:
        mission = _checked(path, plan.scenes[0], plan.robots[0]).mission
        if mission is None:
            continue
        required = {p.key: plan.settings[p.key][0] for p in mission.parameters if p.key in plan.settings}
        for value in plan.settings[name]:
            try:
                read_settings(mission, {**required, name: value})
            except PicktreeError as error:
                yield f"{path.name}: {error}" if len(plan.missions) > 1 else str(error)
                return


def _resolved(plan: BatchPlan, source: Path, scenes_from: Path | None = None) -> BatchPlan:
    """Return the plan with a name and absolute paths, and with None for lists that are empty.

    Paths count from the folder of `source`, of scenes and robots from `scenes_from` where it is given.
    """
    folder = source.parent.absolute()

    def found(names: tuple[str | None, ...], shipped: Collection[str]) -> tuple[str | None, ...]:
        return tuple(name and _found(name, scenes_from or folder, shipped) for name in names) or (None,)

    return replace(
        plan,
        name=plan.name or source.stem,
        missions=tuple(folder / mission for mission in plan.missions),
        scenes=found(plan.scenes, scene_loading.scene_names()),
        robots=found(plan.robots, robot_file.robot_names()),
        faults=tuple(path and folder / path for path in plan.faults) or (None,),
    )


def _found(name: str, folder: Path, shipped: Collection[str]) -> str:
    """Return a shipped name, or the path of a scene or robot file; its suffix may be left out."""
    if name in shipped:
        return name
    own = folder / f"{name}.yaml"
    return str(own if own.is_file() else folder / name)

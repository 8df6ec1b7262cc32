"""Reading scene files. Everything is checked here, before a simulator sees it; all faults come at once."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import yaml

from ..colours import ITEM_COLOURS
from ..errors import PicktreeError
from ..files.checked import Checker
from ..files.document import Document, FileError, load_document, nearest, overlaid, parse_document
from ..files.expressions import Expression, ExpressionError
from ..files.shipped import find_file, shipped_names
from ..values import Bounds
from .areas import check_spawn
from .description import Bin, Destination, Fixture, Limits, SceneDescription, SensorNoise, Spawn, Thinking
from .destinations import check_rule
from .entries import FORMS, body, camera, kind
from .schema import SECTIONS, CameraFile, CatalogueFile, DestinationFile, FixtureFile, RestFile, SpawnFile

SHIPPED = Path(__file__).parent.parent / "scenes"
ROBOTS = Path(__file__).parent.parent / "robots"
MAX_BASES = 5
GOAL_NAMES = ("total", "sorted", "misplaced", "left")


def load_scene(name_or_path: str, beside: Path | None = None) -> SceneDescription:
    """The scene of that shipped name, or of a file whose path counts from `beside`.

    Raises FileError with all faults of the file, PicktreeError when there is no such file.
    """
    return _described(load_document(find_file(name_or_path, SHIPPED, beside, "scene"), "scene"))


def parse_scene(text: str, path: Path) -> SceneDescription:
    """The scene of a file's text, as a log keeps it; `path` is where the file stood."""
    return _described(parse_document(text, path, "scene"))


def scene_names() -> tuple[str, ...]:
    """Names of the shipped scenes."""
    return shipped_names(SHIPPED)


def _described(own: Document) -> SceneDescription:
    document = _on_base(own, MAX_BASES)
    check = Checker(document)
    check.keys((*RestFile.model_fields, *SECTIONS))
    rest = check.read(RestFile, ignore=_not_rest(document))
    robot = _robot(check, rest)
    limits = _limits(check, rest)

    bodies = {name: e and body(check, name, e) for name, e in check.each(FixtureFile, "fixtures").items()}
    cameras = {name: e and camera(check, name, e) for name, e in check.each(CameraFile, "cameras").items()}
    kinds = {name: e and kind(check, name, e) for name, e in check.each(CatalogueFile, "catalogue").items()}
    fixtures = [b for b in bodies.values() if isinstance(b, Fixture)]
    spawn = check.sequence(SpawnFile, "spawn")
    for n, entry in enumerate(spawn):
        if entry is not None:
            # A table that could not be read must not be missed a second time.
            known = None if None in bodies.values() else fixtures
            check_spawn(check, n, entry, kinds, known, limits)
    destinations = check.sequence(DestinationFile, "destinations")
    for n, rule in enumerate(destinations):
        if rule is not None:
            _check_destination(check, n, rule, bodies, kinds)
    if rest is not None and rest.goal is not None:
        _check_goal(check, rest.goal)
    check.finish()
    assert rest is not None
    assert limits is not None
    return SceneDescription(
        name=own.path.stem,
        robot=robot,
        fixtures=tuple(fixtures),
        bins=tuple(b for b in bodies.values() if isinstance(b, Bin)),
        cameras=tuple(c for c in cameras.values() if c is not None),
        catalogue=tuple(k for k in kinds.values() if k is not None),
        spawn=tuple(_spawn(entry) for entry in spawn if entry is not None),
        destinations=tuple(_destination(d, bodies) for d in destinations if d is not None),
        limits=limits,
        thinking=Thinking(rest.thinking.collision_check, rest.thinking.image),
        noise=SensorNoise(rest.sensors.encoder, rest.sensors.width, rest.sensors.force, rest.sensors.torque),
        checkpoint_every=rest.checkpoint_every,
        goal=rest.goal,
        source=str(own.path),
        text=_text(own, document),
    )


def _on_base(document: Document, depth: int) -> Document:
    """The document laid on the scene that its `base:` names."""
    name = document.data.get("base")
    if not isinstance(name, str):
        return document
    if depth == 0:
        raise FileError([document.fault(("base",), f"more than {MAX_BASES} scenes stand on one another")])
    try:
        path = find_file(name, SHIPPED, document.path, "scene")
    except PicktreeError as error:
        raise FileError([document.fault(("base",), str(error))]) from None
    return overlaid(_on_base(load_document(path, "scene"), depth - 1), document)


def _text(own: Document, whole: Document) -> str:
    """The file as it was read; with a base, one text that stands without it."""
    if own is whole:
        return own.text
    data = {key: value for key, value in whole.data.items() if key != "base"}
    return yaml.safe_dump(data, default_flow_style=None, sort_keys=False, allow_unicode=True, width=110)


def _not_rest(document: Document) -> list[str]:
    """Keys that `RestFile` need not see; unknown ones were refused already."""
    return [key for key in document.data if key not in RestFile.model_fields]


def _robot(check: Checker, rest: RestFile | None) -> str:
    """The name of a shipped robot, or the whole path of a robot file."""
    if rest is None:
        return ""
    try:
        path = find_file(rest.robot, ROBOTS, Path(check.document.mark(("robot",)).file), "robot")
    except PicktreeError as error:
        check.fault(("robot",), str(error))
        return ""
    return rest.robot if path.parent == ROBOTS else str(path.resolve())


def _limits(check: Checker, rest: RestFile | None) -> Limits | None:
    if rest is None:
        return None
    low, high = rest.limits.workspace.min, rest.limits.workspace.max
    if any(a >= b for a, b in zip(low, high, strict=True)):
        message = "the workspace is empty: 'max' must be greater than 'min' along x, y and z"
        check.fault(("limits", "workspace"), message)
        return None
    return Limits(rest.limits.force, Bounds(low, high))


def _spawn(entry: SpawnFile) -> Spawn:
    return Spawn(
        counts=tuple(entry.of.items()),
        colours=entry.colours,
        area=(entry.area.min, entry.area.max),
        gap=entry.gap,
        lying=entry.lying,
        tumbled=entry.tumbled,
    )


def _destination(entry: DestinationFile, bodies: dict[str, Fixture | Bin | None]) -> Destination:
    bin_ = bodies[entry.to]
    assert bin_ is not None
    return Destination(entry.where, bin_.id)


def _check_destination(
    check: Checker,
    n: int,
    rule: DestinationFile,
    bodies: dict[str, Fixture | Bin | None],
    kinds: Iterable[str],
) -> None:
    bins = [name for name, found in bodies.items() if found is None or isinstance(found, Bin)]
    if rule.to not in bins:
        check.fault(("destinations", n, "to"), f"there is no bin {rule.to!r}", nearest(rule.to, bins))
    try:
        check_rule(rule.where, ITEM_COLOURS, FORMS, list(kinds))
    except ExpressionError as error:
        check.fault(("destinations", n, "where"), str(error))


def _check_goal(check: Checker, goal: str) -> None:
    try:
        expression = Expression.parse(goal)
        unknown = sorted(expression.names - set(GOAL_NAMES))
        if unknown:
            raise ExpressionError(f"unknown name {unknown[0]!r}; {nearest(unknown[0], GOAL_NAMES)}")
        expression.evaluate(dict.fromkeys(GOAL_NAMES, 1))
    except ExpressionError as error:
        check.fault(("goal",), str(error))

"""Reading scene files. Everything is checked here, before a simulator sees it; all faults come at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import yaml

from picktree.files import (
    INT,
    CheckedFile,
    Diagnostic,
    Expression,
    FileError,
    Location,
    PicktreeError,
    ValueType,
    check_types,
    expression_syntax,
    file_system,
    suggest_name,
)
from picktree.files.yaml import Document, DocumentChecker, file_models, merge_patch, read_document
from picktree.world import Bounds

from .description import (
    MESH_SETS,
    MIN_DETECTABLE_MASS,
    Bin,
    CatalogueEntry,
    Delivery,
    Destination,
    Fixture,
    Hole,
    SceneDescription,
    SceneSettings,
    Spawn,
)
from .destinations import MEASURES, can_hold, rule_names
from .feed_loading import (
    assortment,
    belt,
    check_assortment,
    check_belts,
    check_feed,
    check_spawn,
    check_totes,
    delivery,
    spawn,
)
from .scene_entries import (
    body,
    camera,
    check_body,
    check_camera,
    check_fits,
    check_unknown,
    hidden_body,
    holes,
    kind,
)
from .scene_schema import SECTIONS, CameraFile, CatalogueFile, FixtureFile, SceneFile, UnknownFile


def condition(
    check: DocumentChecker, loc: Location, text: str, names: Mapping[str, ValueType], *, code: str
) -> Expression | None:
    """Return the expression; None for a faulty one, with the fault at its character."""
    try:
        expression = Expression.parse(text)
        kind = check_types(expression, names, {})
        if kind.kind not in ("bool", "any"):
            raise expression_syntax.ExpressionError(f"true or false is wanted, not {kind.words()}")
    except expression_syntax.ExpressionError as error:
        message, _, hint = str(error).partition("; ")
        check.fault(loc, message, hint, code=code, character=error.offset)
        return None
    return expression


SHIPPED = Path(__file__).parents[1] / "scenes"
ROBOTS = Path(__file__).parents[1] / "robots"
MAX_BASES = 5
MAX_ENTRIES = 200
"""Maximum number of entries of a section, for the simulator's sake."""
MAX_RULE_TRIALS = 2_000_000
"""Characters of rules that are evaluated for the question whether any item fulfils them."""
GOAL_NAMES = ("total", "sorted", "misplaced", "left", "outstanding")


@dataclass(frozen=True, slots=True)
class CheckedScene(CheckedFile[SceneDescription]):
    """Result of checking a scene file: the scene, None when there are errors, and all faults."""

    robot: Path | None = None
    """The file of its robot, where there is one."""


def load_scene(name_or_path: str, beside: Path | None = None) -> SceneDescription:
    """Return the shipped scene of that name, or the scene of a file whose path counts from `beside`.

    Raises FileError with all faults of the file, PicktreeError when there is no such file.
    """
    return check_scene(
        read_document(file_system.find_file(name_or_path, SHIPPED, beside, "scene"), "scene")
    ).required()


def parse_scene(text: str, path: Path) -> SceneDescription:
    """Return the scene of a file's text, as a log keeps it; `path` is the original path of the file."""
    return check_scene(read_document(path, "scene", text)).required()


def scene_names() -> tuple[str, ...]:
    """Return the names of the shipped scenes."""
    return file_system.shipped_names(SHIPPED)


def check_scene(own: Document) -> CheckedScene:
    """Check a document of kind `scene` completely; never raises for faults in it.

    That its robot exists is checked; the content of the robot file is not.
    """
    try:
        document = _on_base(own, MAX_BASES)
    except FileError as error:
        return CheckedScene(None, (*error.faults, *_own_faults(own)))
    parts = _Parts(document)
    parts.check()
    found = parts.checker.result(lambda: parts.scene(own))
    return CheckedScene(found.value, found.faults, parts.robot)


def _on_base(document: Document, depth: int) -> Document:
    """Return the document merged into the scene of its `base:`. Raises FileError with the faults of the
    base."""
    name = document.data.get("base")
    if not isinstance(name, str):
        return document
    if depth == 0:
        message = f"more than {MAX_BASES} scenes are based on one another"
        raise FileError([document.fault(("base",), message, code="P402")])
    try:
        path = file_system.find_file(name, SHIPPED, document.path, "scene")
    except PicktreeError as error:
        raise FileError([document.fault(("base",), str(error), code="P402")]) from None
    return merge_patch(_on_base(read_document(path, "scene"), depth - 1), document)


def _own_faults(document: Document) -> list[Diagnostic]:
    """Return the faults that do not depend on the base, which could not be read."""
    return [fault for fault in _Parts(document).checker.faults if fault.code != "P105"]


class _Parts:
    """The parts of a scene file, each as far as it could be read."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.checker = check = DocumentChecker(document)
        settings = file_models.keys_of(SceneSettings)
        check.keys((*settings, *SECTIONS))
        # Unknown keys were refused already.
        self.rest = check.read(SceneSettings, ignore=[key for key in document.data if key not in settings])
        self.bodies = check.each(FixtureFile, "fixtures", most=MAX_ENTRIES)
        self.unknown = check.each(UnknownFile, "unknown", most=MAX_ENTRIES)
        self.cameras = check.each(CameraFile, "cameras", most=MAX_ENTRIES)
        self.kinds = check.each(CatalogueFile, "catalogue", most=MAX_ENTRIES)
        self.spawn = check.sequence(Spawn, "spawn", most=MAX_ENTRIES)
        self.feed = check.sequence(Delivery, "feed", most=MAX_ENTRIES)
        self.destinations = check.sequence(Destination, "destinations", most=MAX_ENTRIES)
        self.catalogue: Mapping[str, CatalogueEntry | None] = {}
        self.robot: Path | None = None
        self.rules: list[tuple[Expression, str]] = []
        """Expression and target of each destination without a fault of its own."""

    def check(self) -> None:
        """Look for faults of meaning in all that could be read."""
        check = self.checker
        with check.readable():
            self.robot = self._robot(self.rest.robot)
        workspace = self._workspace()
        for name, entry in self.bodies.items():
            check_body(check, name, entry)
        for name, entry in self.unknown.items():
            self._check_unknown(name, entry)
        for name, entry in self.cameras.items():
            check_camera(check, name, entry)
        self.catalogue = {name: kind(check, name, entry) for name, entry in self.kinds.items()}
        self._check_calibration()
        standing = self._standing()
        assorted = True
        with check.readable():
            assorted = check_assortment(check, self.rest.assortment)
        for n, entry in enumerate(self.spawn):
            if check.full:
                break
            check_spawn(check, n, entry, self.catalogue, standing, workspace, assorted)
        self._check_feed(standing, workspace, assorted)
        self._check_weights()
        for n, entry in enumerate(self.destinations):
            self._check_destination(n, entry)
        self._check_fits()
        with check.readable():
            if self.rest.goal is not None:
                condition(check, ("goal",), self.rest.goal, dict.fromkeys(GOAL_NAMES, INT), code="P419")

    def scene(self, own: Document) -> SceneDescription:
        """The values of a file without errors."""
        rest = self.rest
        settings = {each.name: getattr(rest, each.name) for each in fields(SceneSettings)}
        bodies = [body(name, entry) for name, entry in self.bodies.items()]
        bins = {str(b.id): b for b in bodies if isinstance(b, Bin)}
        assert self.robot is not None
        if self.robot.parent != ROBOTS:
            settings["robot"] = str(self.robot.resolve())
        settings["base"] = None
        settings["assortment"] = assortment(self.document, rest.assortment)
        return SceneDescription(
            **settings,
            name=own.path.stem,
            fixtures=tuple(b for b in bodies if not isinstance(b, Bin)),
            bins=tuple(bins.values()),
            cameras=tuple(
                camera(name, entry).calibrated(rest.calibration) for name, entry in self.cameras.items()
            ),
            catalogue=tuple(k for k in self.catalogue.values() if k is not None),
            spawn=tuple(spawn(entry, bins) for entry in self.spawn),
            destinations=tuple(self.destinations),
            source=str(own.path),
            text=_text(own, self.document),
            belts=tuple(belt(name, entry) for name, entry in self.bodies.items() if entry.belt is not None),
            deliveries=tuple(delivery(entry, self.bodies) for entry in self.feed),
            unknown=tuple(hidden_body(name, entry) for name, entry in self.unknown.items()),
            files=file_models.located(self.document, SceneFile, MESH_SETS),
        )

    def _robot(self, name: str) -> Path | None:
        """Return the robot file; its path counts from the naming file: this one or its base."""
        try:
            return file_system.find_file(name, ROBOTS, Path(self.document.mark(("robot",)).file), "robot")
        except PicktreeError as error:
            self.checker.fault(("robot",), str(error), code="P401")
            return None

    def _standing(self) -> list[Fixture | Bin] | None:
        """Return fixtures and bins; None when one of them cannot be read."""
        with self.checker.readable():
            return [
                body(name, entry)
                for name, entry in self.bodies.items()
                if ((entry.bin or entry.tote) is not None and entry.wall is not None)
                or entry.box is not None
                or entry.belt is not None
                or entry.marker is not None
            ]
        return None

    def _workspace(self) -> Bounds | None:
        """Return the workspace; None for a faulty one."""
        with self.checker.readable():
            workspace = self.rest.limits.workspace
            if all(a < b for a, b in zip(workspace.min, workspace.max, strict=True)):
                return workspace
            message = "the workspace is empty: 'max' must be greater than 'min' along x, y and z"
            self.checker.fault(("limits", "workspace"), message, code="P415")
        return None

    def _check_feed(
        self, standing: list[Fixture | Bin] | None, workspace: Bounds | None, assorted: bool
    ) -> None:
        check = self.checker
        for n, entry in enumerate(self.feed):
            if check.full:
                return
            check_feed(check, n, entry, self.catalogue, self.bodies, standing, workspace, assorted)
        with check.readable():
            check_totes(check, self.feed, exchanged=self.rest.exchange is not None)
        check_belts(check, self.bodies, self.feed, workspace)
        with check.readable():
            if self.rest.exchange is not None and not any(map(self._may_be_bin, self.bodies)):
                message, hint = "there is no bin that could be exchanged", "a fixture with 'bin'"
                check.fault(("exchange",), message, hint, code="P425", key=True, severity="warning")

    def _check_weights(self) -> None:
        """Warn of items that are lighter than the wrist sensor can detect."""
        check = self.checker
        with check.readable():
            for name in dict.fromkeys(kind for entry in (*self.spawn, *self.feed) for kind in entry.counts):
                known = self.catalogue.get(name)
                if known is not None and known.mass < MIN_DETECTABLE_MASS:
                    message = f"{1000 * known.mass:g} g are less than the wrist sensor can reliably measure"
                    least = f"below {1000 * MIN_DETECTABLE_MASS:g} g"
                    hint = f"{least} only the opening of the fingers shows that the hand holds the item"
                    check.fault(("catalogue", name, "mass"), message, hint, code="P427", severity="warning")

    def _check_unknown(self, name: str, entry: UnknownFile) -> None:
        if name in self.bodies:
            hint = "give one of them another name"
            message = f"the name {name!r} is taken by a fixture"
            self.checker.fault(("unknown", name), message, hint, code="P403", key=True)
        check_unknown(self.checker, ("unknown", name), entry)

    def _check_destination(self, n: int, rule: Destination) -> None:
        check = self.checker
        with check.readable():
            # An unreadable body may be a bin, and is not reported as missing here.
            bins = [name for name in self.bodies if self._may_be_bin(name)]
            bored = self._holes()
            if rule.to not in bins and rule.to not in bored and rule.to.partition("/")[0] not in bins:
                what = "bin or hole" if bored else "bin"
                hint = suggest_name(rule.to, (*bins, *bored))
                check.fault(("destinations", n, "to"), f"there is no {what} {rule.to!r}", hint, code="P416")
        with check.readable():
            loc, names = ("destinations", n, "where"), rule_names(self.kinds)
            expression = condition(check, loc, rule.where, names, code="P417")
            # Long rules are tried on fewer items: that takes a bounded time for any file.
            most = max(1, MAX_RULE_TRIALS // (len(self.destinations) * max(1, len(rule.where))))
            if expression is not None and not can_hold(expression, names, most=most):
                units = "; mass is in kg, size in m, tags are 0 … 49"
                measured = units if expression.names & MEASURES.keys() else ""
                hint = f"check the colour, form and kind that it asks for{measured}"
                check.fault(loc, "no item can fulfil this", hint, code="P418")
            if expression is not None:
                self.rules.append((expression, rule.to))

    def _check_calibration(self) -> None:
        check = self.checker
        with check.readable():
            found = self.rest.calibration
            for name in found.cameras if found is not None else ():
                if name not in self.cameras:
                    hint = suggest_name(name, list(self.cameras))
                    loc = ("calibration", "cameras", name)
                    check.fault(loc, f"there is no camera {name!r}", hint, code="P441", key=True)

    def _holes(self) -> Mapping[str, tuple[Hole, ...]]:
        """Return the holes that a destination may name: by the fixture with holes, and by each hole."""
        found: dict[str, tuple[Hole, ...]] = {}
        for name, entry in self.bodies.items():
            with self.checker.readable():
                bored = holes(name, entry) if entry.box is not None else ()
                found |= {name: bored} if bored else {}
                found |= {str(hole.id): (hole,) for hole in bored}
        return found

    def _check_fits(self) -> None:
        """Whether the items that come fit where they belong, when that is known of all."""
        check = self.checker
        if len(self.rules) < len(self.destinations) or check.full:
            return
        with check.readable():
            coming = [
                (kind, colour) for e in (*self.spawn, *self.feed) for kind in e.counts for colour in e.colours
            ]
            trials = len(dict.fromkeys(coming)) * sum(len(rule.where) for rule in self.destinations)
            if trials <= MAX_RULE_TRIALS:
                check_fits(check, self.rules, dict.fromkeys(coming), self.catalogue, self._holes())

    def _may_be_bin(self, name: str) -> bool:
        with self.checker.readable():
            entry = self.bodies[name]
            return (entry.bin or entry.tote) is not None or (
                entry.box is None and entry.belt is None and entry.marker is None
            )
        return True


def _text(own: Document, whole: Document) -> str:
    """Return the text of the file; with a base, one text of both, without a base."""
    if own is whole:
        return own.text
    data = {key: value for key, value in whole.data.items() if key != "base"}
    return yaml.safe_dump(data, default_flow_style=None, sort_keys=False, allow_unicode=True, width=110)

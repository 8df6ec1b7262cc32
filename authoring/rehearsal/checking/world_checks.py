"""Whether a case's facts, objects and parameters are such as the mission and its scene know."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, cast

from ....files.yaml.document import Location, nearest
from ....trees.running.run_settings import parameter_value
from ....trees.values.port_types import show
from ....world.belief.facts import FACTS
from ....world.journal import Plain
from ..cases.case import EMPTY_HAND, Case, Effects, Objects
from ..cases.cases_schema import ObjectFile
from ..cases.partial_models import or_else
from .known_names import Known

_SET_BY_CLOCK = "time"
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


class WorldChecks:
    """Holds what one case says of the world against what there is."""

    def __init__(self, known: Known, case: Case) -> None:
        self._known, self._case = known, case
        scene = known.scene
        fixed = (*(f.id for f in scene.fixtures), *(b.id for b in scene.bins)) if scene else ()
        self._ids = [*_ids(case), *map(str, fixed)]

    def run(self) -> None:
        """All but what answers and expectations say."""
        loc = self._case.loc
        self._parameters()
        self.facts(self._case.facts, loc, "facts", may_set=True)
        self.objects(self._case.objects, loc, "objects")

    def facts(self, given: Mapping[str, object], above: Location, key: str, *, may_set: bool) -> None:
        """`may_set`: the case gives them values; null gives one back, and time cannot be set."""
        for name, value in given.items():
            loc = self._place((*above, key, name))
            if name not in FACTS or (may_set and name == _SET_BY_CLOCK):
                known = [one for one in FACTS if not may_set or one != _SET_BY_CLOCK]
                message = f"there is no fact {name!r}"
                if name == _SET_BY_CLOCK:
                    message = "the time passes by itself, tick by tick"
                self._fault(loc, message, nearest(name, known), "P711", key=True)
            elif not (may_set and value is None) and not _is(value, FACTS[name]):
                message = f"the fact {name!r} is {_WORDS[FACTS[name]]}, not {show(value)}"
                self._fault(loc, message, "", "P711")

    def objects(self, given: Objects, above: Location, key: str) -> None:
        for name, entry in given.items():
            if entry is not None:
                self._object(entry, self._place((*above, key, name)))

    def effects(self, effects: Effects, loc: Location) -> None:
        self.facts(effects.facts, loc, "facts", may_set=True)
        self.objects(effects.objects, loc, "objects")
        if effects.hand is not None and effects.hand != EMPTY_HAND:
            self.objects_named(effects.hand, (*loc, "hand"))

    def objects_named(self, value: object, loc: Location) -> None:
        """A warning for an id of no object that this case ever has in its belief."""
        for one in cast("list[object]", value) if isinstance(value, list) else [value]:
            if isinstance(one, str) and one not in self._ids:
                hint = nearest(one, self._ids) or "list it under 'objects'"
                message = f"no object {one!r} is in the belief of this case"
                self._known.fault(loc, message, hint, code="P717", severity="warning")

    def _object(self, entry: ObjectFile, loc: Location) -> None:
        known = self._known

        def value(key: str) -> Any:
            return or_else(lambda: getattr(entry, key), None)

        known.name((*loc, "kind"), value("kind"), "kind", known.kinds)
        known.name((*loc, "form"), value("form"), "form", known.forms)
        known.name((*loc, "colour"), value("colour"), "colour", known.colours)
        known.name((*loc, "destination"), value("destination"), "bin", known.destinations)
        known.name((*loc, "place"), value("place"), "place", known.places)

    def _parameters(self) -> None:
        if self._known.mission is None:
            return
        ports = {port.key: port for port in self._known.mission.parameters}
        given = cast("Mapping[str, Plain]", self._case.parameters)
        for name, value in given.items():
            loc = self._place((*self._case.loc, "parameters", name))
            if name not in ports:
                hint = nearest(name, ports) or "it has none"
                self._fault(loc, f"the mission has no parameter {name!r}", hint, "P713", key=True)
                continue
            try:
                parameter_value(value, ports[name])
            except ValueError as error:
                self._fault(loc, f"the mission's parameter {name!r}: {error}", ports[name].doc, "P713")
        for port in ports.values():
            if port.required and port.key not in given:
                message = f"the mission's parameter {port.key!r} needs a value"
                self._fault(self._case.loc, message, port.doc, "P713", key=True)

    def _fault(self, loc: Location, message: str, hint: str, code: str, *, key: bool = False) -> None:
        self._known.fault(loc, message, hint, code=code, key=key)

    def _place(self, loc: Location) -> Location:
        """Where it is really said: what stands at the top of the file counts for every case."""
        case = self._case.loc
        if loc[: len(case)] == case and not self._known.given(loc):
            above = loc[len(case) :]
            return above if self._known.given(above) else loc
        return loc


def _ids(case: Case) -> Iterator[str]:
    yield from (name for name, entry in case.objects.items() if entry is not None)
    for script in case.scripts:
        for answer in script.everything:
            yield from (name for name, entry in answer.then.objects.items() if entry is not None)


def _is(value: object, kind: type) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))

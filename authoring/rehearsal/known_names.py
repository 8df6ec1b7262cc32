"""Names that a cases file may use: nodes of its mission, causes, and names of the mission's scene."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from ...files.marks import Location, Severity
from ...files.value_wording import suggest_name
from ...files.yaml.document_checker import DocumentChecker
from ...trees.mission import Mission
from ...world.belief.facts import ASIDE
from ...world.causes import Cause, all_causes, matches
from ...world.colours import ITEM_COLOURS
from ...world.scene.description import Form, SceneDescription
from .rehearsal_world import HAND, TABLE, UNKNOWN
from .trace import NodeRole, roles_of


class CaseNames:
    """Valid names, and the errors about unknown ones.

    Without a mission only names common to every mission are checked.
    """

    def __init__(
        self, check: DocumentChecker, mission: Mission | None, scene: SceneDescription | None
    ) -> None:
        self._check, self.mission, self.scene = check, mission, scene
        self.roles = roles_of(mission) if mission else None
        played = (role for role in (self.roles.all if self.roles else ()) if role.played)
        self.in_need = tuple(role for role in played if role.needed)
        """Leaves with outputs that a case must give."""
        self._fitting: dict[str, tuple[NodeRole, ...]] = {}

    def fault(
        self,
        loc: Location,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
        severity: Severity = "error",
    ) -> None:
        self._check.fault(loc, message, hint, code=code, key=key, severity=severity)

    def given(self, loc: Location) -> bool:
        """Whether the file has a value at that place."""
        node = self._check.document.root
        for part in loc:
            below = node.child(part)
            if below is None:
                return False
            node = below
        return True

    # Nodes.

    def nodes(self, pattern: str, loc: Location, *, key: bool = False) -> tuple[NodeRole, ...]:
        """Return the nodes that match a pattern; report an error when there are none. `Main` itself has no
        pattern."""
        if self.roles is None or not pattern.strip("/"):
            return ()
        if pattern not in self._fitting:
            self._fitting[pattern] = self.roles.fitting(pattern)
        found = self._fitting[pattern]
        if not found:
            message = f"no node of the mission fits {pattern!r}"
            self.fault(loc, message, self._near(pattern), code="P703", key=key)
        return found

    def leaves(self, pattern: str, loc: Location, *, key: bool = False) -> tuple[NodeRole, ...]:
        """Return the stubbed leaves that match a pattern; report an error when there are none."""
        found = self.nodes(pattern, loc, key=key)
        played = tuple(role for role in found if role.played)
        if found and not played:
            kind = found[0].spec.id
            message = f"{pattern!r} is a node of the language ({kind}), which answers for itself"
            self.fault(loc, message, suggest_name("", self._names(played=True)), code="P704", key=key)
        return played

    def _near(self, pattern: str) -> str:
        assert self.roles is not None
        last = pattern.rstrip("/").rpartition("/")[2]
        there = next((role.path for role in self.roles.all if role.spec.name.partition("#")[0] == last), None)
        return f"{last!r} stands at {there}" if there else suggest_name(last, self._names(played=False))

    def _names(self, *, played: bool) -> list[str]:
        """Return the names of nodes, the leaves first, each once."""
        assert self.roles is not None
        wanted = [role for role in self.roles.all if role.played or not played]
        ordered = sorted(wanted, key=lambda role: not role.played)
        return list(dict.fromkeys(role.spec.name.partition("#")[0] for role in ordered))

    # Causes.

    def cause(self, name: str, loc: Location, *, family: bool = False) -> tuple[Cause, ...]:
        """Return the causes of that name, or with `family` of the pattern; report an error when there are
        none."""
        known = [cause.name for cause in all_causes()]
        if family:
            stems = {one.rpartition(".")[0] for one in known}
            known += [f"{stem}.*" for stem in sorted(stems)]
        if name in known or (family and name == "*"):
            return tuple(cause for cause in all_causes() if matches(name, cause))
        prefixes = {cause.name.partition(".")[0] for cause in all_causes()}
        if self.mission is not None or name.partition(".")[0] in prefixes:  # else it may be a plug-in's
            self.fault(loc, f"no cause is called {name!r}", suggest_name(name, known), code="P705")
        return ()

    # Scene.

    @property
    def kinds(self) -> tuple[str, ...] | None:
        return (*(entry.kind for entry in self.scene.catalogue), UNKNOWN) if self.scene else None

    @property
    def forms(self) -> tuple[str, ...]:
        return (*get_args(Form), UNKNOWN)

    @property
    def colours(self) -> tuple[str, ...]:
        return (*ITEM_COLOURS, UNKNOWN)

    @property
    def bins(self) -> tuple[str, ...] | None:
        return tuple(str(one.id) for one in self.scene.bins) if self.scene else None

    @property
    def holes(self) -> tuple[str, ...]:
        return tuple(str(hole.id) for f in self.scene.fixtures for hole in f.holes) if self.scene else ()

    @property
    def destinations(self) -> tuple[str, ...] | None:
        """Bins, fixtures with holes, and their holes; None when the scene is unknown."""
        if self.scene is None or self.bins is None:
            return None
        return (*self.bins, *(str(f.id) for f in self.scene.fixtures if f.holes), *self.holes)

    @property
    def places(self) -> tuple[str, ...] | None:
        return None if self.bins is None else (TABLE, HAND, ASIDE, *self.bins, *self.holes)

    def name(self, loc: Location, value: str | None, what: str, known: Iterable[str] | None) -> None:
        """Report a name that the scene does not have. `known` None: the scene's names are unknown."""
        if value is None or known is None:
            return
        names = list(known)
        if value not in names:
            self.fault(loc, f"there is no {what} {value!r}", suggest_name(value, names), code="P712")

"""World of a rehearsal: a clock that counts ticks, a belief and a journal, without a robot.

Nothing is measured. Objects, hand and facts follow from the leaves' answers. A successful leaf changes the
hand as declared (`hand_after`), and a dropped object lies on the table again. A leaf with the camera that
succeeds counts as a look. The case defines everything else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NoReturn

from picktree.trees import NodeDeclaration, Resource, control_flow
from picktree.world import (
    BeliefObject,
    Box,
    Cause,
    Entry,
    Failure,
    Journal,
    JournalEvent,
    ObjectId,
    PlanningScene,
    Pose,
    facts,
    hole_geometry,
    matches,
    safety,
    world,
    world_facts,
)
from picktree.world import grasp as grasp_causes
from picktree.world.scene import CatalogueEntry, SceneDescription, destinations

from .cases import EMPTY_HAND, BelievedObject, Effects, Objects, PlacedAnswer
from .trace import ScriptedAnswers, Trace

TABLE = "table"
HAND = "hand"
UNKNOWN = "unknown"
_DEFAULT_SHAPE = Box((0.04, 0.04, 0.04))
"""Shape of an object whose kind is in no catalogue; nothing is computed with it."""


_COPIED = ("form", "colour", "role", "mass", "confidence", "last_seen", "sigma_position", "sigma_angle")
"""Keys of an object in a case that become attributes of the belief as they are."""


class Contradiction(Exception):
    """Impossible answer in a case: it ends the case, and is never a failure of the mission."""

    path = ""
    """Path of the leaf that gives the answer."""


class MissingOutput(Contradiction):
    """Success without an output that the mission reads; `answer`: None where the case gives none."""

    def __init__(self, leaf: str, port: str, answer: PlacedAnswer | None) -> None:
        super().__init__(f"{leaf} succeeds without its output {port!r}")
        self.port, self.answer = port, answer


class Belief:
    """Planning scene of a rehearsal, with derived facts and those that a case sets."""

    def __init__(self, scene: SceneDescription | None) -> None:
        self._exhausted = scene is None or not scene.deliveries
        self._done = 0
        self._rules = scene.destinations if scene else ()
        self._rule = destinations.destination_rule(self._rules)
        self._catalogue = {entry.kind: entry for entry in scene.catalogue} if scene else {}
        self._known_bins = scene is not None
        self._destinations: dict[str, ObjectId | None] = {}
        self._set: dict[str, bool | int | float | str] = {}
        self._looked = False
        self._stopped = False
        self.scene = PlanningScene(
            scene.fixtures if scene else (), scene.bins if scene else (), self._destination
        )

    def facts(self, now: float) -> Mapping[str, bool | int | float | str]:
        found = facts(
            self.scene,
            looked=self._looked,
            stopped=self._stopped,
            exhausted=self._exhausted,
            done=self._done,
            now=now,
        )
        return {**found, **self._set}

    def misplaced_for_want_of(self) -> Iterator[tuple[BeliefObject, tuple[str, ...]]]:
        """Yield items in a bin that is not their destination, with the unknown traits that rules ask for."""
        for item in self.scene.objects:
            lacking = destinations.unknown_traits(self._rules, item)
            elsewhere = item.place in self.scene.bins and item.place != self._destination(item)
            if elsewhere and lacking and item.id not in self._destinations:
                yield item, lacking

    def to_do(self) -> list[str]:
        """Ids of the items to do, the held one first."""
        return [o.id for o in sorted(world_facts.items_to_do(self.scene), key=lambda o: not o.attached)]

    # Changes by the case.

    def apply(self, effects: Effects) -> None:
        """Apply effects. Raises Contradiction when the hand should hold an unknown object."""
        self.change(effects.objects)
        self.pin(effects.facts)
        if effects.hand == EMPTY_HAND:
            self.let_go()
        elif effects.hand is not None:
            if self.scene.find(effects.hand) is None:
                raise Contradiction(f"the hand is to hold {effects.hand!r}, which is not in the belief")
            self.let_go()
            self.scene.attach(effects.hand, Pose())

    def pin(self, given: Mapping[str, object]) -> None:
        """Set facts to the case's values; None resets a fact."""
        for name, value in given.items():
            if isinstance(value, bool | int | float | str):
                self._set[name] = value
            else:
                self._set.pop(name, None)

    def change(self, objects: Objects) -> None:
        for name, entry in objects.items():
            if entry is None:
                self.scene.remove(name, "as the case says")
            else:
                self._put(ObjectId(name), entry)

    def let_go(self, place: str = TABLE) -> None:
        held = self.scene.held
        if held is not None:
            self.scene.detach(held.id, held.pose, place)

    # Consequences of a leaf's answer.

    def succeeded(
        self, leaf: NodeDeclaration, hand: control_flow.Hand, inputs: Mapping[str, Any], *, of_itself: bool
    ) -> None:
        """Apply a leaf's success, with `hand` as declared; `of_itself`: no case has defined the answer.

        Outputs that the answer gives are among the inputs.

        Raises Failure when the leaf must fail instead, Contradiction when it cannot succeed.
        """
        if Resource.ARM in leaf.uses and self._set.get("stopped", self._stopped):
            self._move(leaf, of_itself=of_itself)
        if Resource.CAMERA in leaf.uses:
            self._looked = True
        if hand == "full":
            self._fill(leaf, inputs, of_itself=of_itself)
        elif hand == "empty":
            self._empty(leaf, inputs)

    def failed(self, cause: Cause) -> None:
        """Apply the changes of the world that a cause implies."""
        if cause in (grasp_causes.MISSED, grasp_causes.SLIPPED):
            self.let_go()
        if cause is safety.NO_RETREAT:
            # A node with this failure has acknowledged the stop; the arm stays where it is.
            self._stopped = False
        elif matches("safety.*", cause):
            self._stopped = True

    def _move(self, leaf: NodeDeclaration, *, of_itself: bool) -> None:
        """Apply a latched stop: it refuses every motion but that of a leaf that brings the arm to safety."""
        if leaf.hand_after == "kept":
            self._stopped = False
            self._set.pop("stopped", None)
        elif of_itself:
            raise Failure(safety.STOP, "a safety stop is not acknowledged")
        else:
            raise Contradiction(f"{leaf.id} moves the arm, which a safety stop holds")

    def _fill(self, leaf: NodeDeclaration, inputs: Mapping[str, Any], *, of_itself: bool) -> None:
        wanted = _object_of(leaf, inputs)
        if wanted is None:
            return
        if self.scene.find(wanted) is None:
            if of_itself:
                self.scene.get(wanted)  # raises Failure(world.unknown_object)
            raise Contradiction(f"{leaf.id} takes {wanted!r}, which is not in the belief")
        held = self.scene.held
        if held is not None and held.id != wanted:
            raise Contradiction(f"{leaf.id} takes {wanted!r} while the hand holds {held.id!r}")
        if held is None:
            self.scene.attach(wanted, Pose())

    def _empty(self, leaf: NodeDeclaration, inputs: Mapping[str, Any]) -> None:
        wanted, held = _object_of(leaf, inputs), self.scene.held
        place = next(
            (str(inputs[p.key]) for p in leaf.inputs if p.names == "bin" and inputs.get(p.key)), TABLE
        )
        if place != TABLE:
            self._refuse_unknown(place)
        elif held is not None and any(p.names == "hole" for p in leaf.inputs):
            place = self._seat(leaf, inputs, held)
        if wanted is not None and (held is None or held.id != wanted):
            holds = f"holds {held.id!r}" if held else "is empty"
            raise Contradiction(f"{leaf.id} lets go of {wanted!r} while the hand {holds}")
        bin_ = self.scene.bins.get(ObjectId(place))
        if held is not None and bin_ is not None and bin_.is_tote:
            self.scene.remove(held.id, "put back into the tote")
            return
        self._done += wanted is not None
        self.let_go(place)

    def _seat(self, leaf: NodeDeclaration, inputs: Mapping[str, Any], held: BeliefObject) -> str:
        """Return the hole for the held object; its destination where no free hole for it is known."""
        named = next((inputs[p.key] for p in leaf.inputs if p.names == "hole" and inputs.get(p.key)), None)
        into = str(named or self.scene.destination(held.id) or TABLE)
        if (
            self._known_bins
            and named
            and hole_geometry.named_holes(self.scene.fixtures.values(), into) is None
        ):
            raise Failure(world.UNKNOWN_OBJECT, f"the scene has no hole {into!r}")
        hole = hole_geometry.fitting_hole(self.scene, held.id, into)
        return into if hole is None else str(hole.id)

    def take_away(self, bin_id: str) -> None:
        """Replace a bin with an empty one. Raises Failure when there is none of that name."""
        self._refuse_unknown(bin_id)
        for belief in self.scene.objects:
            if belief.place == bin_id:
                self.scene.remove(belief.id, world_facts.TAKEN_AWAY)

    def _refuse_unknown(self, bin_id: str) -> None:
        if self._known_bins and bin_id not in self.scene.bins:
            raise Failure(world.UNKNOWN_OBJECT, f"there is no bin {bin_id!r}", known=list(self.scene.bins))

    # Objects.

    def _destination(self, belief: BeliefObject) -> ObjectId | None:
        return self._destinations[belief.id] if belief.id in self._destinations else self._rule(belief)

    def _put(self, identity: ObjectId, entry: BelievedObject) -> None:
        known = self.scene.find(identity)
        belief = known or BeliefObject(
            UNKNOWN, UNKNOWN, _DEFAULT_SHAPE, UNKNOWN, Pose(), 0.0, 0.0, 1.0, 0.0, id=identity
        )
        if entry.kind is not None:
            belief = _of_kind(belief, entry.kind, self._catalogue.get(entry.kind))
        changes: dict[str, Any] = {
            name: value for name in _COPIED if (value := getattr(entry, name)) is not None
        }
        belief = replace(belief, **changes)
        if entry.destination is not None:
            name = entry.destination.name
            self._destinations[identity] = ObjectId(name) if name else None
        if entry.place == HAND and not belief.attached:
            self.let_go()
            belief = replace(belief, object_in_tcp=Pose(), place=HAND)
        elif entry.place is not None and entry.place != HAND:
            belief = replace(belief, object_in_tcp=None, place=entry.place)
        self.scene.put(belief, "as the case says")


def _of_kind(belief: BeliefObject, kind: str, known: CatalogueEntry | None) -> BeliefObject:
    if known is None:
        return replace(belief, kind=kind)
    return replace(belief, kind=kind, form=known.form, shape=known.shape)


def _object_of(leaf: NodeDeclaration, values: Mapping[str, Any]) -> str | None:
    """Return the object that a leaf takes or releases: the first at an object port, but for places.

    A leaf without such an input says which it has taken.
    """
    for port in (*leaf.inputs, *(leaf.outputs if leaf.hand_after == "full" else ())):
        if port.type.name == "object" and not port.type.many and port.names is None:
            return str(values[port.key]) if values.get(port.key) else None
    return None


TICK_PERIOD = 0.05
"""Simulated time between two ticks, s, as in a run."""


class TickClock:
    """Simulated time: the number of past ticks times TICK_PERIOD."""

    def __init__(self) -> None:
        self.ticks = 0

    @property
    def now(self) -> float:
        return self.ticks * TICK_PERIOD


class _Notes(Journal):
    """Journal that forwards events instead of storing them for a log."""

    def __init__(self, trace: Trace) -> None:
        super().__init__()
        self._trace = trace

    def note(self, entry: Entry) -> None:
        if isinstance(entry, JournalEvent):
            self._trace.noted(entry)


class RehearsalWorld:
    """World that nodes see during a rehearsal: only the part that control nodes need."""

    tick = TICK_PERIOD

    def __init__(self, scene: SceneDescription | None, prompter: ScriptedAnswers, trace: Trace) -> None:
        self.clock = TickClock()
        self.belief = Belief(scene)
        self.prompter = prompter
        self.trace = trace
        self.journal: Journal = _Notes(trace)
        self.attempts = world_facts.AttemptMemory()
        self.contradictions: list[Contradiction] = []

    @property
    def scene(self) -> PlanningScene:
        return self.belief.scene

    def facts(self) -> Mapping[str, bool | int | float | str]:
        return self.belief.facts(self.clock.now)

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"in a rehearsal there is no world.{name}: no robot is simulated")

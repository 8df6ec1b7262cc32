"""Cell in Python: robot, world and simulation, with views of belief, plans and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from picktree.analysis.render import parse_view
from picktree.apps.commissioning import PlanAnswer, PlanRefusal, plan_figures, plan_picture
from picktree.files import PicktreeError, suggest_name
from picktree.logs import PandasTable
from picktree.robot import World
from picktree.robot.manipulation import grasp_candidates
from picktree.robot.planning import MotionPlan, Request, Scaling, Target
from picktree.session import CellSession
from picktree.world import Array, BeliefObject, Failure, Pose

from .display import SceneImage, html_table, preformatted

PICTURE_SIZE = (960, 600)


class BelievedItem(Mapping[str, object]):
    """Believed object at the time of its look-up; later changes do not appear in it.

    As a mapping it is a row of the belief's table: id, kind, colour, form, place, destination, x, y, z of the
    position in the world (m), yaw (rad), confidence (0 … 1), last_seen (simulated s).
    """

    def __init__(self, belief: BeliefObject, cell: CellSession) -> None:
        self.belief = belief
        """Complete belief about it: shape, uncertainty, time of the last look."""
        self._gripper = cell.world.robot.description.gripper
        self.id = str(belief.id)
        self.kind, self.colour, self.place = belief.kind, belief.colour, belief.place
        self.pose = belief.pose
        """Pose in the world; position in m."""
        destination = cell.world.scene.destination(belief.id)
        self.destination = str(destination) if destination is not None else None
        """Bin of its destination; None: no destination."""

    def grasp(self, *, above: float = 0.0) -> tuple[Pose, ...]:
        """Return the TCP poses in the world to grasp it from above, the best first, raised by `above` m.

        Neighbours, bins and the arm's reach are left to the planner. Empty when it is wider than the gripper.
        """
        found = grasp_candidates(self.belief, self._gripper)
        return tuple(dict.fromkeys(each.tcp_in_world.shifted((0.0, 0.0, above)) for each in found))

    def _row(self) -> dict[str, object]:
        x, y, z = self.pose.position
        return {
            "id": self.id,
            "kind": self.kind,
            "colour": self.colour,
            "form": self.belief.form,
            "place": self.place,
            "destination": self.destination,
            "x": x,
            "y": y,
            "z": z,
            "yaw": self.pose.rpy()[2],
            "confidence": self.belief.confidence,
            "last_seen": self.belief.last_seen,
        }

    def __getitem__(self, column: str) -> object:
        return self._row()[column]

    def __iter__(self) -> Iterator[str]:
        return iter(self._row())

    def __len__(self) -> int:
        return len(self._row())

    # An object is the same as itself only, although it is a mapping.

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    def __repr__(self) -> str:
        x, y, z = self.pose.position
        return f"<{self.id}: {self.colour} {self.kind} at ({x:.3f}, {y:.3f}, {z:.3f}) m, {self.place}>"


class BeliefView(Sequence[BelievedItem], PandasTable):
    """Belief of the robot about the cell: a sequence of objects, and a table."""

    def __init__(self, cell: CellSession) -> None:
        self._items = tuple(BelievedItem(each, cell) for each in cell.world.scene.objects)
        held = cell.world.scene.held
        self.held = next((item for item in self._items if held is not None and item.id == held.id), None)
        """Object in the hand; None: the hand is believed to be empty."""

    def find(self, id: str | None = None, **attributes: str) -> BelievedItem:
        """Return the first object with this id, or these attributes: colour, kind, place, destination, form.

        Raises PicktreeError without such an object, TypeError for an unknown attribute.
        """
        found = self.all(id, **attributes)
        if found:
            return found[0]
        wanted = " ".join(filter(None, (id, *(f"{name}={value}" for name, value in attributes.items()))))
        known = ", ".join(item.id for item in self._items) or "nothing; run Observe first"
        raise PicktreeError(f"nothing is believed to be {wanted}; believed: {known}")

    def all(self, id: str | None = None, **attributes: str) -> tuple[BelievedItem, ...]:
        """Return all objects with this id, or these attributes. Raises TypeError for an unknown attribute."""
        for name in attributes:
            if name not in _ATTRIBUTES:
                raise TypeError(f"an object has no attribute {name!r} ({suggest_name(name, _ATTRIBUTES)})")
        return tuple(
            item
            for item in self._items
            if (id is None or item.id == id)
            and all(_attribute(item, name) == value for name, value in attributes.items())
        )

    def __getitem__(self, index: int) -> BelievedItem:  # type: ignore[override]
        return self._items[index]

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[BelievedItem]:
        return iter(self._items)

    def columns_by_name(self) -> Mapping[str, Sequence[object]]:
        """Return a column for each key of `BelievedItem`; empty while nothing is believed."""
        rows = [dict(item) for item in self._items]
        return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}

    def __repr__(self) -> str:
        return "\n".join(map(repr, self._items)) or "nothing is believed to be there; run Observe first"

    def _repr_html_(self) -> str:
        rows = [
            (
                item.id,
                item.colour,
                item.kind,
                ", ".join(f"{1000 * each:.1f}" for each in item.pose.position),
                item.place,
                item.destination or "",
            )
            for item in self._items
        ]
        return html_table(("id", "colour", "kind", "position, mm", "place", "destination"), rows)


_ATTRIBUTES = ("colour", "kind", "place", "destination", "form")


def _attribute(item: BelievedItem, name: str) -> str | None:
    return item.belief.form if name == "form" else getattr(item, name)


@dataclass(frozen=True, slots=True, eq=False)
class PlanOutcome:
    """Plan of a motion, or the reason of the refusal. It is true when there is a plan."""

    world: World
    start: Array
    """Configuration of the arm (n,), rad."""
    outcome: MotionPlan | Failure
    answer: PlanAnswer
    """Figures of the plan, or its refusal with cause, sentence, remedy and evidence."""

    def __bool__(self) -> bool:
        return self.plan is not None

    @property
    def plan(self) -> MotionPlan | None:
        """Plan for `Cell.move`; None after a refusal."""
        return self.outcome if isinstance(self.outcome, MotionPlan) else None

    def show(self, *, view: str = "corner", size: tuple[int, int] = PICTURE_SIZE) -> SceneImage:
        """Return a picture of start, path and goal; for a refusal, of the bodies in collision."""
        at = parse_view(view)
        return SceneImage(plan_picture(self.world, self.start, self.outcome, self.answer.asked, at, size))

    @property
    def cause(self) -> str:
        """Cause of the refusal, as `planning.no_ik`; empty when there is a plan."""
        return self.answer.refused.cause if self.answer.refused else ""

    @property
    def message(self) -> str:
        """Sentence on why there is no plan; empty when there is one."""
        return self.answer.refused.message if self.answer.refused else ""

    def __repr__(self) -> str:
        return "\n".join(self.answer.lines())

    def _repr_html_(self) -> str:
        return preformatted(repr(self))


class Cell(CellSession):
    """Robot in a scene for single skills and motions. Simulated time passes only during these.

        with Cell("three_bins", backend="kinematic", seed=3) as cell:
            cell.run(Observe(camera="overhead"))
            cell.run(Grasp(object=cell.belief.find(colour="red").id))

    `scene` is a shipped scene or a scene file; `robot` a robot or robot file instead of the scene's; `faults`
    a faults file. `backend` is `physics`, or `kinematic`, which is fast: objects follow the gripper, sensors
    have no noise. The same calls with the same seed give the same run. Raises PicktreeError for files that
    cannot be used.
    """

    @property
    def belief(self) -> BeliefView:
        """Present belief about the objects."""
        return BeliefView(self)

    def plan(
        self,
        target: Target,
        *,
        speed: float = 1.0,
        clearance: float = 0.0,
        allowed: tuple[tuple[str, str], ...] = (),
    ) -> PlanOutcome:
        """Plan a motion from the arm's present configuration, without moving it.

        `target` is a goal such as `PoseGoal(poses)`; `speed` a share of the joints' limits; `clearance` an
        addition to the margins, m; `allowed` pairs of names that may touch. `move` runs the plan.
        """
        world = self.world
        start = world.control.held_position
        scaling = Scaling(velocity=speed, acceleration=speed)
        request = Request(target, scaling=scaling, clearance=clearance, allowed=allowed)
        words = type(target).__name__
        answer = PlanAnswer(
            world.description.name, world.robot.description.name, self.seed, words, "its present pose"
        )
        outcome: MotionPlan | Failure
        try:
            outcome = self.solve(request)
            answer = replace(answer, found=plan_figures(world, outcome))
        except Failure as failure:
            outcome = failure
            answer = replace(answer, refused=PlanRefusal.of(failure))
        return PlanOutcome(world, start, outcome, answer)

    def move(self, plan: MotionPlan | PlanOutcome) -> None:
        """Move the arm along a plan.

        Raises Failure when something stops it, PicktreeError for a refused plan.
        """
        found = plan.plan if isinstance(plan, PlanOutcome) else plan
        if found is None:
            raise PicktreeError(f"there is no plan to move along:\n{plan}")
        super().move(found)

    def show(self, *, view: str = "corner", size: tuple[int, int] = PICTURE_SIZE) -> SceneImage:
        """Return a picture of the robot and its belief at present.

        `view` is a name such as `top` or `front`, or `AZIMUTH,ELEVATION,DISTANCE` in degrees and m.
        """
        world = self.world
        width = world.gripper.width
        q, name = world.control.state.position, world.description.name
        return SceneImage(plan_picture(world, q, None, name, parse_view(view), size, width, self.time))

    def __repr__(self) -> str:
        world = self.world
        return f"<cell {world.description.name}, {world.robot.description.name}, at {self.time:.2f} s>"

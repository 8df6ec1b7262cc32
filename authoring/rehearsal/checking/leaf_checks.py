"""Whether the leaves of a mission can answer as a case says."""

from __future__ import annotations

from ....files.yaml.document import Location
from ....trees.condition import ConditionNode
from ....trees.declaration import NodeDeclaration
from ....trees.skill import Skill
from ....trees.values.port_types import convert
from ....world.causes import Cause, internal, matches, tree, world
from ..cases.case import Answer, Case
from ..stage.node_roles import Role, may_fail_with
from .known_names import Known
from .world_checks import WorldChecks

_ALWAYS = (tree.MISSING_INPUT, tree.TIMEOUT, world.UNKNOWN_OBJECT, internal.ERROR)
"""What every node may fail with; with a fault of the program because some want it handled."""


class LeafChecks:
    """Holds the answers of one case against the leaves that give them."""

    def __init__(self, known: Known, case: Case, worlds: WorldChecks) -> None:
        self._known, self._case, self._worlds = known, case, worlds

    def run(self) -> None:
        answered: set[str] = set()
        for script in self._case.scripts:
            played = self._known.leaves(script.pattern, script.loc, key=True)
            left = [role for role in played if role.path not in answered]
            own = script.loc[:1] == ("cases",)
            if played and not left and own:
                message = f"{script.pattern!r} is never used: patterns before it fit all that it fits"
                self._known.fault(
                    script.loc, message, "put it first", code="P716", key=True, severity="warning"
                )
            for answer in script.everything:
                self._answer(answer, left)
            if script.answers:
                answered.update(role.path for role in left)
        for role in self._known.in_need:
            if role.path not in answered:
                self._outputs(Answer(self._case.loc), role, of_itself=True)

    def _answer(self, answer: Answer, roles: list[Role]) -> None:
        self._worlds.effects(answer.then, (*answer.loc, "then"))
        causes = self._known.cause(answer.cause, _at(answer, "cause")) if answer.cause else ()
        said: set[tuple[object, ...]] = set()
        for role in roles:
            alike = (role.spec.node, role.causes)  # which may differ with the wiring
            if alike in said:
                continue
            said.add(alike)
            self._possible(answer, role, causes)
            self._given_outputs(answer, role)
        needing = [role for role in roles if role.needed] if answer.status == "SUCCESS" else []
        for role in needing:
            if self._outputs(answer, role, of_itself=False):
                break

    def _possible(self, answer: Answer, role: Role, causes: tuple[Cause, ...]) -> None:
        node, identity = role.spec.node, role.spec.id
        assert node is not None
        skill, condition = issubclass(node, Skill), issubclass(node, ConditionNode)

        def impossible(key: str, message: str, hint: str = "") -> None:
            self._known.fault(_at(answer, key), message, hint, code="P710")

        if condition and (answer.status in ("RUNNING", "SKIPPED") or answer.ticks):
            what = "it takes no ticks" if answer.ticks else f"it is never {answer.status}"
            impossible("ticks" if answer.ticks else "status", f"{identity} is a condition: {what}")
        if skill and answer.status == "SKIPPED":
            hint = "it is skipped by its '_skipIf' or '_while', which is asked in a rehearsal, too"
            impossible("status", f"{identity} is a skill, which does not skip itself", hint)
        declared = role.causes
        if skill and answer.status == "FAILURE" and not answer.cause:
            names = ", ".join(map(str, declared))
            hint = f"one of {names}" if names else "it declares none: it cannot fail"
            impossible("status", f"{identity} is a skill, which fails for a cause", hint)
        allowed = (*may_fail_with(role), *_ALWAYS)
        for cause in causes:
            if not any(matches(str(one), cause) for one in allowed):
                names = ", ".join(map(str, declared)) or "none"
                message = f"{identity} does not fail with {cause}"
                self._known.fault(_at(answer, "cause"), message, f"it declares {names}", code="P706")

    def _given_outputs(self, answer: Answer, role: Role) -> None:
        assert role.spec.node is not None
        declaration = role.spec.node.declaration
        for key, value in answer.outputs.items():
            loc: Location = (*answer.loc, "outputs", key)
            port = declaration.port(key)
            if port is None or port.direction != "out":
                self._unknown_output(declaration, key, loc)
                continue
            try:
                converted = convert(value, port.type, port.unit, port.choices, port.within)
            except ValueError as error:
                self._known.fault(loc, f"output {key!r} of {declaration.id}: {error}", port.doc, code="P708")
                continue
            if port.type.name == "object":
                self._worlds.objects_named(converted, loc)

    def _unknown_output(self, declaration: NodeDeclaration, key: str, loc: Location) -> None:
        from ....files.yaml.document import nearest

        known = [port.key for port in declaration.outputs]
        hint = nearest(key, known) if known else "it has none"
        self._known.fault(loc, f"{declaration.id} has no output {key!r}", hint, code="P707", key=True)

    def _outputs(self, answer: Answer, role: Role, *, of_itself: bool) -> bool:
        """A fault for an output that somebody may read and nobody gives; whether there was one."""
        assert role.spec.node is not None
        declaration = role.spec.node.declaration
        for port in role.needed:
            if port.key in answer.outputs:
                continue
            if of_itself:
                message = f"{role.path} has no answer, but an output {port.key!r} that the mission uses"
            else:
                message = f"{declaration.id} succeeds without its output {port.key!r}, used at {role.path}"
            hint = f"as {{outputs: {{{port.key}: …}}}}: {port.doc}"
            self._known.fault(answer.loc, message, hint, code="P709", key=of_itself)
            return True
        return False


def _at(answer: Answer, key: str) -> Location:
    return (*answer.loc, key)

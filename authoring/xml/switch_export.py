"""Switches over truth values, which are numbers in BehaviorTree.CPP: their cases are 1 and 0 there."""

from __future__ import annotations

from functools import cached_property
from graphlib import CycleError
from typing import Final

from ...trees.circuit import ValueFlow
from ...trees.key_writers import FACT_TYPES, TreeKeys
from ...trees.mission import Mission, NodeSpec
from ...trees.references import Constant, Reference

TRUTH_LABELS: Final = {"true": "1", "false": "0"}


class TruthSwitches:
    """Finder of the Switches of a mission that a truth value decides."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission

    def decides(self, spec: NodeSpec) -> bool | None:
        """Return whether a truth value decides a Switch; None where it may be one, or something else."""
        bound = spec.ports["variable"]
        if isinstance(bound, Constant):
            return isinstance(bound.value, bool)
        keys = self._keys.get(id(spec))
        if keys is None or not isinstance(bound, Reference):
            return False
        kinds = {source.type.kind for source in keys.reference(bound)}
        if kinds == {"bool"}:
            return True
        return None if "bool" in kinds else False

    @cached_property
    def _keys(self) -> dict[int, TreeKeys]:
        """Return the keys of a node's tree, by `id` of the node's spec."""
        try:
            flow = ValueFlow(self._mission.trees, FACT_TYPES)
        except CycleError:
            return {}
        return {place: keys for keys in flow.keys.values() for place in keys.places}

"""Labels of Switches that truth values decide, which are numbers in BehaviorTree.CPP."""

from __future__ import annotations

from collections.abc import Mapping

from ...files.marks import Mark
from ...files.yaml.writer import MarkedValue
from ...trees.loading.loader import MissionReadResult
from ...trees.references import Reference
from .import_faults import ImportFaults

_LABELS = {"1": "true", "0": "false"}


def label_switches(
    reading: MissionReadResult, tables: Mapping[Mark, MarkedValue], faults: ImportFaults
) -> bool:
    """Rename the cases 1 and 0 of Switches over truth values; return whether any was renamed.

    `tables`: the cases by the place of the Switch. A case `true` is never chosen by BehaviorTree.CPP.
    """
    changed = False
    if reading.circuit is None:
        return False
    for keys in reading.circuit.keys.values():
        for placed in keys.places.values():
            table, bound = tables.get(placed.spec.mark), placed.spec.ports.get("variable")
            if placed.spec.id != "Switch" or table is None or not isinstance(bound, Reference):
                continue
            kinds = {source.type.kind for source in keys.reference(bound)}
            if kinds != {"bool"}:
                continue
            for entry in table.entries or ():
                if entry.key in _LABELS:
                    entry.key, changed = _LABELS[entry.key], True
                elif entry.key in _LABELS.values():
                    message = f"{bound} is a truth value, which is never {entry.key!r} in BehaviorTree.CPP"
                    number = "1" if entry.key == "true" else "0"
                    faults.fault(entry.value.mark, placed.path, message, f"write {number!r}", code="P911")
    return changed

"""A plan as a batch's folder keeps it."""

from __future__ import annotations

from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ...errors import PicktreeError
from ...files.atomic_write import whole
from .plan import Plan

NAME = "plan.json"
_ADAPTER = TypeAdapter(Plan)


def write_plan(plan: Plan, folder: Path) -> None:
    """Raises PicktreeError when it cannot be written."""
    with whole([folder / NAME], folder / NAME) as (beside,):
        beside.write_bytes(_ADAPTER.dump_json(plan, indent=1))


def read_plan(folder: Path) -> Plan:
    """Raises PicktreeError when there is none."""
    try:
        return _ADAPTER.validate_json((folder / NAME).read_bytes())
    except OSError:
        raise PicktreeError(f"{folder}: no batch: there is no {NAME} in it") from None
    except ValidationError as error:
        raise PicktreeError(f"{folder / NAME}: no plan of a batch: {error.errors()[0]['msg']}") from None

"""Journal events: what they record, and how they are read back."""

import runpy
from collections.abc import Mapping
from dataclasses import MISSING, FrozenInstanceError, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import orjson
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from picktree.logs import BeliefEvent, RunResult, encode, event_record, topics
from picktree.logs.event_records import decode_event
from picktree.world import EVENT_KINDS, Journal, JournalEvent, OtherEvent, event_fields
from picktree.world.event_types import (
    FaultEvent,
    HandledEvent,
    ItemDoneEvent,
    PickEvent,
    PushEvent,
    RecoveryEvent,
    SafetyStopEvent,
    event_of,
)

Validator: Any = Draft202012Validator


def recorded(event: JournalEvent) -> dict[str, object]:
    values: dict[str, object] = orjson.loads(encode(event_record(event)))
    return values


def test_fields_are_recorded_in_their_order_and_read_back() -> None:
    event = RecoveryEvent("a cure", "Main", cause="grasp.missed", failed="Main/Grasp", handler="grasp.*")
    assert list(event.data) == ["cause", "failed", "reason", "handler", "attempt", "ends"]
    assert decode_event(encode(event_record(event))) == event
    assert refused("recovery", event.data) == ""


def test_a_field_that_is_none_by_default_is_left_out() -> None:
    assert PushEvent("parted", object="a", strokes=("left", "right")).data == {
        "object": "a",
        "strokes": ["left", "right"],
    }
    handled = HandledEvent("passed over", "Main", cause=None, by="ForEach", element="a", failed="Main/Grasp")
    assert handled.data == {"cause": None, "by": "ForEach", "element": "a", "failed": "Main/Grasp"}


def test_evidence_is_recorded_behind_the_fields() -> None:
    stop = SafetyStopEvent("too much force", cause="safety.force_limit", extra={"force": [1.0, 2.0, 3.0]})
    assert recorded(stop)["data"] == {"cause": "safety.force_limit", "force": [1.0, 2.0, 3.0]}
    assert decode_event(encode(event_record(stop))) == stop


@pytest.mark.parametrize(
    "data",
    [
        {"fault": "slip", "friction": 0.1, "lasts": None, "item": "item_00"},
        {"fault": "slip", "item": "item_00", "gone": True},
        {"fault": "friction", "item": "a", "kind": "ball", "colour": "red", "friction": 0.1, "mass": None},
        {"fault": "larger", "item": "item_00", "kind": "ball", "colour": "red", "factor": 2.0, "waits": True},
        {"fault": "obstacle", "obstacle": "obstacle_1", "at": [0.1, 0.2, 0.3]},
        {"fault": "obstacle", "obstacle": "obstacle_1", "gone": True},
        {"fault": "remove", "item": None},
        {"fault": "appear", "kind": "ball", "colour": "red", "item": None},
        {"fault": "hang", "skill": None},
        {"fault": "raise", "skill": "Main/Grasp"},
        {"fault": "camera_drop", "camera": "overhead", "lasts": 2.0},
    ],
)
def test_a_fault_is_recorded_in_the_order_of_old_logs(data: dict[str, object]) -> None:
    event = event_of("fault", "it happens", "", data)
    assert isinstance(event, FaultEvent)
    assert orjson.dumps(event.data) == orjson.dumps(data)


def test_a_fault_that_waits_or_has_ended_has_not_struck() -> None:
    assert FaultEvent("it slips", fault="slip", item="item_00").struck
    assert not FaultEvent("it waits", fault="obstacle", waits=True).struck
    assert not FaultEvent("it ends", fault="slip", gone=True).struck
    assert event_of("fault", "no item fits", "", {"fault": "remove", "item": None}) == FaultEvent(
        "no item fits", fault="remove", extra={"item": None}
    )


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        ("wiped", {"with": "a cloth"}),
        ("pick", {"held": True}),
        ("pick", {"object": "a", "held": "yes"}),
        ("pick", {"object": 3, "held": True}),
        ("replanned", {"object": "a", "cause": "c", "why": "w", "by": "none", "time": 1, "most": 2}),
        ("belief", {"version": 1, "object": "a", "reason": "seen", "before": None, "after": {"id": "a"}}),
    ],
)
def test_an_unknown_or_incomplete_event_keeps_its_values(kind: str, data: dict[str, object]) -> None:
    event = decode_event(orjson.dumps({"kind": kind, "message": "m", "node": "n", "data": data}))
    assert event == OtherEvent("m", "n", name=kind, extra=data)
    assert (event.kind, event.data) == (kind, data)


def test_a_pick_of_an_older_log_lacks_its_measurements() -> None:
    event = event_of("pick", "held", "Main/Grasp", {"object": "a", "held": True})
    assert event == PickEvent("held", "Main/Grasp", object="a", held=True)
    null = event_of("pick", "held", "", {"object": "a", "held": True, "width": None, "load": 1})
    assert isinstance(null, PickEvent)
    assert (null.width, null.load) == (None, 1)


def test_values_of_a_younger_version_are_kept() -> None:
    event = event_of("item_done", "placed", "", {"object": "a", "into": "", "colour": "red"})
    assert event == ItemDoneEvent("placed", object="a", into="", extra={"colour": "red"})
    assert event.data == {"object": "a", "form": "", "into": "", "colour": "red"}


def test_a_plug_in_declares_a_kind_of_its_own() -> None:
    @dataclass(frozen=True, kw_only=True)
    class WipedEvent(JournalEvent, kind="wiped"):
        """The table was wiped."""

        area: Annotated[float, "wiped area, m²"]

    try:
        assert event_of("wiped", "clean", "Main/Wipe", {"area": 0.5}) == WipedEvent(
            "clean", "Main/Wipe", area=0.5
        )
        assert refused_branch("wiped", {"area": "all"}) == ["'all' is not of type 'number'"]
        assert schema_of_topic()["properties"]["data"]["properties"]["area"] == {"type": "number"}
    finally:
        del EVENT_KINDS["wiped"]


def test_a_kind_is_a_frozen_dataclass_from_its_first_event_on() -> None:
    class BentEvent(JournalEvent):
        """A finger is bent."""

        finger: str
        angle: Annotated[float, "angle", "rad"] = 0.5

    assert [(each.name, each.default, each.unit) for each in event_fields(BentEvent)] == [
        ("finger", MISSING, ""), ("angle", 0.5, "rad"),
    ]  # fmt: skip
    event = BentEvent("bent", finger="left")
    assert event == replace(event, finger="left") != replace(event, angle=1.0)
    assert repr(event).endswith("BentEvent(message='bent', node='', extra={}, finger='left', angle=0.5)")
    with pytest.raises(FrozenInstanceError):
        event.angle = 1.0  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(TypeError, match="finger"):
        BentEvent("bent")  # pyright: ignore[reportCallIssue]


def test_values_with_a_factory_are_fields_of_a_kind() -> None:
    class ListedEvent(JournalEvent):
        """Things were listed."""

        things: Annotated[list[str], "things"] = field(default_factory=list[str])

    assert [each.required for each in event_fields(ListedEvent)] == [False]
    assert ListedEvent("listed").data == {"things": []}


def test_the_journal_counts_items_that_are_done() -> None:
    journal = Journal()
    journal.note(ItemDoneEvent("placed", object="a"))
    journal.note(OtherEvent("placed", name="item_done", extra={}))
    journal.note(PickEvent("held", object="a", held=True))
    assert journal.items_done == 2
    assert len(journal.take()) == 3


def test_a_change_of_the_belief_is_read_with_its_bodies() -> None:
    body = {
        "id": "a", "kind": "ball", "form": "ball", "colour": "red", "shape": {"radius": 0.02},
        "pose": {"position": [0.1, 0.2, 0.3], "orientation": [0.0, 0.0, 0.0, 1.0]}, "role": "item",
    }  # fmt: skip
    data = {"version": 2, "object": "a", "reason": "seen", "before": None, "after": body}
    event = decode_event(orjson.dumps({"kind": "belief", "message": "a: seen", "node": "", "data": data}))
    assert isinstance(event, BeliefEvent)
    assert event.before is None
    assert event.after is not None
    assert (event.after.colour, event.after.pose.position) == ("red", (0.1, 0.2, 0.3))


def test_the_document_has_all_kinds_with_their_fields() -> None:
    docs = Path(__file__).parents[2] / "docs"
    made = runpy.run_path(str(docs / "events_page.py"))["events_page"]()
    assert (docs / "events.md").read_text(encoding="utf-8") == made, "renew it: make docs"


@pytest.mark.parametrize("kind", EVENT_KINDS.values(), ids=EVENT_KINDS)
def test_every_field_of_a_kind_says_what_it_holds(kind: type[JournalEvent]) -> None:
    assert kind.__doc__
    assert all(each.meaning for each in event_fields(kind))


def schema_of_topic() -> dict[str, Any]:
    said: dict[str, Any] = orjson.loads(topics.EVENTS.schema_data())
    return said


def refused(kind: str, data: Mapping[str, object]) -> str:
    """The first fault that a validator finds in an event; empty for a valid one."""
    event = {"kind": kind, "message": "m", "node": "", "data": data}
    faults = Validator(schema_of_topic()).iter_errors(event)
    fault = next(iter(faults), None)
    return "" if fault is None else fault.message


def test_the_schema_in_the_log_holds_for_all_events_of_a_run(picked: RunResult) -> None:
    with (picked.folder / "log.mcap").open("rb") as stream:
        found = list(make_reader(stream).iter_messages(topics=[topics.EVENTS.name]))
    assert found[0][0] is not None
    validator = Validator(orjson.loads(found[0][0].data))
    Validator.check_schema(validator.schema)
    kinds: set[str] = set()
    for _, _, message in found:
        event = orjson.loads(message.data)
        validator.validate(event)
        kinds.add(event["kind"])
    assert {"pick", "belief", "image", "item_done"} <= kinds <= set(EVENT_KINDS)


def test_the_schema_knows_the_values_of_each_kind() -> None:
    assert refused("pick", {"object": "a", "held": True, "load": None}) != "", "a null is left out"
    assert refused("pick", {"object": "a", "held": True, "width": 0.01, "by_feel": 3}) == ""
    assert "'held' is a required property" in refused_branch("pick", {"object": "a"})
    assert "'no' is not of type 'boolean'" in refused_branch("pick", {"object": "a", "held": "no"})
    assert refused("fault", {"fault": "remove", "item": None}) == ""
    handled = {"cause": None, "by": "ForEach", "element": {"id": ["a", 3]}, "failed": "Main/Grasp"}
    assert refused("handled", handled) == ""
    assert refused("handled", {**handled, "cause": 3}) != ""


def refused_branch(kind: str, data: Mapping[str, object]) -> list[str]:
    """The faults that the schema of the event's own kind has."""
    (branch,) = (
        each for each in schema_of_topic()["oneOf"] if each["properties"]["kind"].get("const") == kind
    )
    event = {"kind": kind, "message": "m", "node": "", "data": data}
    return [fault.message for fault in Validator(branch).iter_errors(event)]


def test_the_schema_allows_kinds_that_nobody_declares() -> None:
    assert refused("wiped", {"with": "a cloth", "area": [[1, 2], None]}) == ""


def test_viewers_are_offered_the_values_that_have_one_type() -> None:
    """They resolve no alternatives: what is null, or of another type in another kind, is in `oneOf` alone."""
    offered = schema_of_topic()["properties"]["data"]["properties"]
    assert (offered["held"], offered["width"]) == ({"type": "boolean"}, {"type": "number"})
    assert offered["choices"] == {"type": "array", "items": {"type": "string"}}
    assert not {"cause", "by", "time", "element", "tiles", "item", "before"} & set(offered)

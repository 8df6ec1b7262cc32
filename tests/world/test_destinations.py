"""Rules of destinations: what they may ask of an item, and which of them names its bin."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files import FileError
from picktree.world import Box, ConvexMesh, Cylinder, ObjectId, Shape, Sphere, greatest_length
from picktree.world.scene import SceneDescription, load_scene, parse_scene
from picktree.world.scene.description import Destination
from picktree.world.scene.destinations import ItemTraits, destination_rule


def scene(rule: str) -> SceneDescription:
    text = "picktree: 1\nkind: scene\nbase: three_bins\n"
    return parse_scene(f'{text}destinations:\n  - {{where: "{rule}", to: red_bin}}\n', Path("scene.yaml"))


def test_the_first_rule_that_holds_names_the_bin() -> None:
    class Thing:
        def __init__(self, colour: str, form: str, kind: str) -> None:
            self.colour, self.form, self.kind = colour, form, kind

    rule = destination_rule(load_scene("three_bins_by_shape").destinations)
    assert rule(Thing("red", "sphere", "ball")) == "round_bin"
    assert rule(Thing("red", "plate", "plate")) == "plate_bin"
    assert rule(Thing("red", "mesh", "nut")) == "box_bin"
    assert rule(Thing("red", "cone", "cone")) is None


@pytest.mark.parametrize("rule", ["mass > 60", "size > 80", "mass < 0", "mass > 0.06 and size > 2"])
def test_a_rule_that_takes_grams_or_millimetres_is_refused(rule: str) -> None:
    with pytest.raises(FileError) as caught:
        scene(rule)
    told = str(caught.value)
    assert "no item can fulfil this" in told and "mass is in kg, size in m" in told


@pytest.mark.parametrize("rule", ["mass > 0.06", "size <= 0.08 and colour == 'blue'", "0.03 < mass < 0.2"])
def test_rules_compare_mass_and_size(rule: str) -> None:
    assert scene(rule).destinations


def test_a_rule_holds_only_for_what_is_known() -> None:
    rules = [
        Destination("mass > 0.06 and size > 0.05", ObjectId("heavy")),
        Destination("kind == 'unknown'", ObjectId("rest")),
    ]
    rule = destination_rule(rules)
    assert rule(ItemTraits("red", "mesh", "unknown", 0.07, 0.06)) == "heavy"
    assert rule(ItemTraits("red", "mesh", "unknown", 0.05, 0.06)) == "rest"
    assert rule(ItemTraits("red", "mesh", "unknown", 0.07, 0.04)) == "rest"
    assert rule(ItemTraits("red", "mesh", "unknown", None, 0.06)) == "rest", "nobody has weighed it"
    assert rule(ItemTraits("red", "mesh", "block", None, 0.06)) is None


@pytest.mark.parametrize(
    ("shape", "length"),
    [
        (Box((0.03, 0.04, 0.12)), 0.13),
        (Sphere(0.02), 0.04),
        (Cylinder(0.015, 0.04), 0.05),
        (ConvexMesh(((0, 0, 0), (0.03, 0, 0), (0, 0.04, 0), (0, 0, 0.01)), ""), 0.05),
    ],
)
def test_the_size_of_a_body_is_the_greatest_distance_in_it(shape: Shape, length: float) -> None:
    assert greatest_length(shape) == pytest.approx(length)

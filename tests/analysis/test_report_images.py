"""What is packed of the camera: its images in the best quality that there is room for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.report.sensor_panels import images_within_budget, pack_images
from picktree.logs import CameraImage, Stamped
from picktree.world import Intrinsics


def shots(count: int) -> list[Stamped[CameraImage]]:
    """Pictures with some texture, a second apart."""
    rng = np.random.default_rng(5)
    rough = rng.integers(0, 255, (30, 40, 3), dtype=np.uint8)
    colour = cv2.resize(rough, (320, 240), interpolation=cv2.INTER_CUBIC).astype(np.uint8)
    depth = np.linspace(0.5, 0.9, 240 * 320, dtype=np.float32).reshape(240, 320)
    intrinsics = Intrinsics(320, 240, 280.0, 280.0, 160.0, 120.0)
    return [Stamped(float(k), CameraImage("overhead", colour, depth, intrinsics)) for k in range(count)]


def opened(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


def test_images_look_as_they_did_and_depth_is_a_scale_of_colours() -> None:
    (source,) = shots(1)
    (picture,) = images_within_budget([source], 1_000_000)
    seen = cv2.cvtColor(opened(picture.colour), cv2.COLOR_BGR2RGB)
    assert seen.shape == (240, 320, 3)
    assert np.abs(seen.astype(int) - source.record.colour.astype(int)).mean() < 6
    assert (picture.nearest, picture.farthest) == pytest.approx((0.5, 0.9))
    depth = opened(picture.depth)
    near, far = depth[2, 2].astype(int), depth[-3, -3].astype(int)
    assert near.sum() > far.sum() + 150


@pytest.mark.parametrize("budget", [120_000, 60_000, 20_000])
def test_all_images_together_keep_to_their_budget(budget: int) -> None:
    pictures = images_within_budget(shots(20), budget)
    assert sum(len(p.colour) + len(p.depth) for p in pictures) <= budget
    assert pictures[0].time == 0.0
    if len(pictures) > 1:
        assert pictures[-1].time == 19.0


def test_a_small_budget_costs_quality_before_it_costs_images() -> None:
    good, fair = images_within_budget(shots(20), 1_000_000), images_within_budget(shots(20), 300_000)
    assert len(good) == len(fair) == 20
    assert len(fair[0].colour) < len(good[0].colour)


def test_images_of_a_run_come_with_what_was_found(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        section = pack_images(run)
        taken = [at.time for at in run.events if at.record.kind == "image"]
    assert isinstance(section.data, Mapping)
    images = section.data["images"]
    assert isinstance(images, list)
    assert [image["time"] for image in images] == taken  # type: ignore[index, call-overload]
    assert section.data["note"] == ""
    assert len(images[0]["findings"]) == 4  # type: ignore[index, call-overload, arg-type]

"""What the servo had been told is in the log beside what the joints did."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np

from picktree.analysis import Run
from picktree.logs import RunResult
from picktree.logs.log_records import Control
from picktree.logs.recording import Recorder


def test_the_error_is_the_reference_less_the_position(picked: RunResult) -> None:
    with Run(picked.log) as run:
        told, joints = run.controls, run.joints
        assert told.times.tolist() == joints.times.tolist()
        assert {"Hold", "Track"} <= set(told.controllers)
        moving = np.array(told.controllers) == "Track"
        assert np.ptp(told.references[moving], axis=0).max() > 0.5
        servo = np.isfinite(told.references[:, 0])
        was = told.references - told.errors
        np.testing.assert_allclose(was[servo], joints.positions[servo, :7], atol=1e-12)
        assert servo[moving].all()


def test_while_torques_are_commanded_there_is_no_reference(sample: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with Recorder(path, sample.RUN) as recorder:
        sample.start(recorder)
        recorder.control(0.0, Control("Hold", (0.5, 1.0), (0.001, 0.0)))
        recorder.control(0.05, Control("Comply"))
    with Run(path) as run:
        assert run.controls.controllers == ("Hold", "Comply")
        assert run.controls.references[0].tolist() == [0.5, 1.0]
        assert np.isnan(run.controls.references[1]).all()
        assert np.isnan(run.controls.errors[1]).all()

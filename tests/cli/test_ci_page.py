"""docs/ci.md and the hook for pre-commit: their files have the keys that are known, their commands run."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from ..commands import call

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PAGE = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")
WORKFLOW, *CONFIGS = (
    yaml.load(text, yaml.BaseLoader) for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
)
HOOKS: list[dict[str, Any]] = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8"))

WORKFLOW_KEYS = {"name", "run-name", "on", "permissions", "env", "defaults", "concurrency", "jobs"}
JOB_KEYS = {
    "name", "permissions", "needs", "if", "runs-on", "environment", "concurrency", "outputs", "env",
    "defaults", "steps", "timeout-minutes", "strategy", "continue-on-error", "container", "services", "uses",
    "with", "secrets",
}  # fmt: skip
STEP_KEYS = {
    "id", "if", "name", "uses", "run", "working-directory", "shell", "with", "env", "continue-on-error",
    "timeout-minutes",
}  # fmt: skip
HOOK_KEYS = {
    "id", "name", "entry", "language", "alias", "files", "exclude", "types", "types_or", "exclude_types",
    "additional_dependencies", "args", "always_run", "fail_fast", "pass_filenames", "description",
    "language_version", "log_file", "minimum_pre_commit_version", "require_serial", "stages", "verbose",
}  # fmt: skip


def test_the_workflow_has_known_keys() -> None:
    assert WORKFLOW.keys() <= WORKFLOW_KEYS
    assert {"on", "jobs"} <= WORKFLOW.keys()
    for job in WORKFLOW["jobs"].values():
        assert job.keys() <= JOB_KEYS
        assert "runs-on" in job
        for step in job["steps"]:
            assert step.keys() <= STEP_KEYS
            assert ("uses" in step) != ("run" in step)
            assert re.fullmatch(r"[\w-]+/[\w./-]+@v\d+", step.get("uses", "a/b@v1"))


def test_the_hook_and_the_configurations_have_known_keys() -> None:
    (hook,) = HOOKS
    assert hook.keys() <= HOOK_KEYS
    assert {"id", "name", "entry", "language"} <= hook.keys()
    shipped, local = (config["repos"][0] for config in CONFIGS)
    assert shipped.keys() == {"repo", "rev", "hooks"}
    assert [each["id"] for each in shipped["hooks"]] == [hook["id"]]
    assert local.keys() == {"repo", "hooks"}
    assert {key: local["hooks"][0][key] for key in ("id", "name", "entry")} == {
        key: hook[key] for key in ("id", "name", "entry")
    }


@pytest.fixture
def missions(tmp_path: Path) -> Path:
    """A repository with one mission and its cases."""
    (tmp_path / "missions" / "cases").mkdir(parents=True)
    for name in ("sort_by_colour.yaml", "cases/sort_by_colour.yaml"):
        shutil.copy(EXAMPLES / name, tmp_path / "missions" / name)
    return tmp_path


def run_steps(folder: Path) -> dict[str, tuple[int, str]]:
    """Run the steps of the workflow that call picktree; return exit code and output by name."""
    (folder / "bin").mkdir(exist_ok=True)
    (folder / "bin" / "picktree").write_text(f'#!/bin/sh\nexec {sys.executable} -m picktree "$@"\n')
    (folder / "bin" / "picktree").chmod(0o755)
    done: dict[str, tuple[int, str]] = {}
    for step in WORKFLOW["jobs"]["missions"]["steps"]:
        if "picktree " in step.get("run", "") and "pip" not in step["run"]:
            shell = f"export PATH={folder / 'bin'}:$PATH\n{step['run']}"
            ran = subprocess.run(
                ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", shell],
                cwd=folder, capture_output=True, text=True,
            )  # fmt: skip
            done[step["name"]] = ran.returncode, ran.stdout + ran.stderr
    return done


@pytest.mark.slow
def test_the_steps_run(missions: Path) -> None:
    done = run_steps(missions)
    assert {name: code for name, (code, _) in done.items()} == {
        "Check": 0, "Check for code scanning": 0, "Rehearse": 0,
    }  # fmt: skip
    assert (missions / "picktree.sarif").read_text().startswith("{")
    assert (missions / "results" / "sort_by_colour.xml").is_file()
    mission = missions / "missions" / "sort_by_colour.yaml"
    mission.write_text(mission.read_text(encoding="utf-8").replace("scene:", "scenes:"), encoding="utf-8")
    done = run_steps(missions)
    assert [code for code, _ in done.values()] == [2, 0, 1]
    assert "::error file=missions/sort_by_colour.yaml,line=" in done["Check"][1]


def test_the_hook_takes_what_pre_commit_gives_it(missions: Path) -> None:
    (missions / "compose.yaml").write_text("services: {}\n")
    (hook,) = HOOKS
    program, *words = hook["entry"].split()
    assert program == "picktree"
    ran = call([*words, "missions/sort_by_colour.yaml", "compose.yaml"], missions)
    assert (ran.returncode, ran.stdout) == (
        0, "1 file, no errors or warnings; 1 YAML file without 'picktree:' left out\n",
    )  # fmt: skip

"""The libraries of a run are imported without those that only draw."""

from __future__ import annotations

import subprocess
import sys

RUN = """
import sys
import picktree.session.session
print([name for name in sys.modules if name.partition(".")[0] in ("matplotlib", "mpl_toolkits")])
"""
DRAWING = """
from toppra import parametrizer
from toppra.algorithm import algorithm
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
assert "pyplot.py" in plt.__file__
print([module.plt.subplot is plt.subplot for module in (parametrizer, algorithm)])
"""


def _printed(program: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_a_run_imports_no_matplotlib_and_toppra_draws_as_before() -> None:
    assert _printed(RUN + DRAWING) == ["[]", "[True, True]"]


def test_toppra_has_the_matplotlib_that_is_loaded_already() -> None:
    program = "import matplotlib\nimport picktree.session.session\n" + DRAWING
    assert _printed(program + "print(type(parametrizer.plt) is type(plt))") == ["[True, True]", "True"]

"""BehaviorTree.CPP itself: `BTCPP_PREFIX` names where its library is, and a small driver uses it."""

from __future__ import annotations

import hashlib
import os
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from ..needs import Need

PREFIX = Path(os.environ.get("BTCPP_PREFIX") or "/nonexistent")
SOURCE = Path(__file__).with_name("btcpp_driver.cpp")
_KINDS = ("Action", "Condition", "Control", "Decorator")


def _libraries() -> Iterator[Path]:
    for folder in (PREFIX / "lib", PREFIX / "lib64"):
        yield from sorted(folder.glob("libbehaviortree_cpp.*"))


LIBRARY = Need(
    "BehaviorTree.CPP", next(_libraries(), None) is not None, "BTCPP_PREFIX=… names where it is installed"
)


OLD = not (PREFIX / "include/behaviortree_cpp/controls/try_catch_node.h").exists()
"""Whether the library is older than 4.9."""


def built_driver() -> Path:
    """Return the driver's program, compiled when its source or the library is another."""
    library = next(_libraries())
    stamp = f"{library.resolve()} {library.stat().st_mtime_ns}".encode() + SOURCE.read_bytes()
    folder = Path(__file__).parents[2] / ".pytest_cache" / "btcpp"
    program = folder / f"driver-{hashlib.sha256(stamp).hexdigest()[:12]}"
    if not program.exists():
        folder.mkdir(parents=True, exist_ok=True)
        made = program.with_suffix(f".{os.getpid()}")
        command = ["c++", "-std=c++17", "-O0", "-I", str(PREFIX / "include"), str(SOURCE), "-o", str(made),
                   "-L", str(library.parent), "-lbehaviortree_cpp", f"-Wl,-rpath,{library.parent}",
                   "-pthread"]  # fmt: skip
        subprocess.run(command, check=True, capture_output=True, text=True)
        made.rename(program)
    return program


class Driver:
    """A process that loads and ticks trees with BehaviorTree.CPP. Use it in a `with`."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [built_driver()], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> Driver:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.communicate()

    def load(self, xml: str, path: Path) -> str:
        """Return `loaded`, or `refused: ` and why; `path` is a file to write it to.

        Nodes are registered as <TreeNodesModel> declares them, which is what a program does that runs the
        file.
        """
        path.write_text(xml, encoding="utf-8")
        for model in ET.fromstring(xml).iterfind("TreeNodesModel/*"):
            if model.tag in _KINDS:
                self.say(f"node {model.tag} {model.get('ID')}")
                for port in model:
                    self.say(f"port {port.tag} {port.get('name')} {port.get('type', 'BT::AnyTypeAllowed')}")
        return self.ask(f"load {path}")

    def write(self, key: str, value: object) -> None:
        """Write to the root's blackboard. Truth values are numbers in scripts."""
        if isinstance(value, str):
            self.say(f"set {key} string {value}")
        else:
            self.say(f"set {key} double {float(value)}")  # type: ignore[arg-type]

    def ask(self, line: str) -> str:
        self.say(line)
        assert self._process.stdout is not None
        answer = self._process.stdout.readline()
        assert answer, f"BehaviorTree.CPP crashed at: {line}"
        return answer.rstrip("\n")

    def kill(self) -> None:
        """End the process. A question that waits is answered by AssertionError."""
        self._process.kill()

    def say(self, line: str) -> None:
        """Send a line that has no answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

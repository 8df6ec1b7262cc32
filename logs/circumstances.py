"""On what a run is computed: the machine, the libraries, and picktree's own sources.

None of it is part of a run. It stands in the log for the question why a run comes out otherwise elsewhere.
"""

from __future__ import annotations

import hashlib
import platform
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

LIBRARIES: Final = (
    "picktree",
    "pybullet",
    "pin",
    "coal",
    "ompl",
    "python-fcl",
    "py-trees",
    "numpy",
    "scipy",
    "toppra",
    "opencv-python-headless",
    "trimesh",
    "mcap",
)
SOURCES: Final = "sources.txt"
"""Name of the attachment."""
_ROOT: Final = Path(__file__).resolve().parent.parent
_ROOMS: Final = ("world", "trees", "skills", "recovery")
_SIMD: Final = ("sse", "ssse", "avx", "fma", "f16c", "bmi", "asimd", "neon", "sve")


def versions(libraries: Iterable[str] = LIBRARIES) -> dict[str, str]:
    return {library: _version(library) for library in libraries}


@cache
def machine() -> Mapping[str, str]:
    """The computer and its system."""
    model, flags = _processor()
    return {
        "processor": model,
        "vector instructions": flags,
        "architecture": platform.machine(),
        "system": platform.platform(),
    }


@cache
def revision() -> str:
    """Git revision of the checkout that runs, empty for an installed wheel."""
    if not (_ROOT / ".git").exists():
        return ""
    answer = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=_ROOT, capture_output=True, text=True, check=False
    )
    return answer.stdout.strip()


@cache
def sources() -> Mapping[str, str]:
    """The files of picktree that decide what a run does: the beginning of each one's SHA-256, by its path."""
    return {
        file.relative_to(_ROOT).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()[:12]
        for file in _own_files()
    }


def sources_to_text(hashes: Mapping[str, str]) -> str:
    """As `sha256sum` writes it."""
    return "".join(f"{digest}  {path}\n" for path, digest in hashes.items())


def sources_from_text(text: str) -> dict[str, str]:
    """The inverse of `sources_to_text`."""
    pairs = (line.split("  ", 1) for line in text.splitlines() if "  " in line)
    return {path: digest for digest, path in pairs}


def _own_files() -> Iterator[Path]:
    for room in _ROOMS:
        for file in sorted((_ROOT / room).rglob("*")):
            if file.suffix in (".py", ".yaml") and file.is_file():
                yield file
    yield from sorted((_ROOT / "logs").glob("*.py"))


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "unknown"


def _processor() -> tuple[str, str]:
    """Model and vector instructions."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or platform.machine(), ""
    pairs = (line.partition(":") for line in text.splitlines())
    words = {key.strip(): value.strip() for key, _, value in pairs}
    flags = (words.get("flags") or words.get("Features") or "").split()
    model = words.get("model name") or platform.processor() or platform.machine()
    return model, " ".join(sorted(flag for flag in flags if flag.startswith(_SIMD)))

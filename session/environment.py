"""Computing environment of a run: the machine, the libraries, and picktree's own sources.

None of it is part of a run. The log holds it to explain why a run differs on another machine.
"""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Final

from picktree.files import file_system, library_parts

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
    "coacd",
    "mcap",
)
SOURCES_ATTACHMENT: Final = "sources.txt"
"""Name of the attachment with the hashes of the sources."""
_FILES_WITHOUT_EFFECT: Final = (
    "__init__.py",
    "__main__.py",
    "analysis",
    "apps",
    "authoring",
    "logs/item_episodes.py",
    "logs/episode_counts.py",
    "logs/run_account.py",
    "session/attach_socket.py",
    "session/live_view.py",
    "session/resumption.py",
)
"""Modules and folders that do not affect a run: commands, batches, and readers of logs."""
_MAX_NAMED_FILES: Final = 5
"""Maximum number of files that a sentence names. For more it gives the count."""
_SIMD_PREFIXES: Final = ("sse", "ssse", "avx", "fma", "f16c", "bmi", "asimd", "neon", "sve")


def versions(libraries: Iterable[str] = LIBRARIES) -> dict[str, str]:
    return {library: library_parts.library_version(library) for library in libraries}


@cache
def machine() -> Mapping[str, str]:
    """Return processor, vector instructions, architecture and operating system."""
    model, flags = _processor()
    return {
        "processor": model,
        "vector instructions": flags,
        "architecture": platform.machine(),
        "system": platform.platform(),
    }


@cache
def revision() -> str:
    """Return the Git revision of the checkout that runs; empty for an installed wheel.

    `-dirty` at its end: a file has changed since. Documents do not count.
    """
    if not (file_system.ROOT / ".git").exists():
        return ""

    def git(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["git", *words], cwd=file_system.ROOT, capture_output=True, text=True, check=False
        )

    commit = git("describe", "--always").stdout.strip()
    changed = commit and git("diff", "--quiet", "HEAD", "--", ".", ":!docs").returncode == 1
    return f"{commit}-dirty" if changed else commit


@cache
def sources() -> Mapping[str, str]:
    """Return the first 12 digits of the SHA-256 of each source file that affects a run, by path."""
    return hashes(_run_files())


def hashes(files: Iterable[str | Path]) -> dict[str, str]:
    """Return the first 12 digits of each file's SHA-256 by its path in the package."""
    start, found = len(str(file_system.ROOT)) + 1, dict[str, str]()
    for path in map(str, files):
        with open(path, "rb", buffering=0) as file:
            found[path[start:]] = hashlib.sha256(file.read()).hexdigest()[:12]
    return found


def sources_to_text(hashes: Mapping[str, str]) -> str:
    """Return the hashes in the format of `sha256sum`."""
    return "".join(f"{digest}  {path}\n" for path, digest in hashes.items())


def sources_from_text(text: str) -> dict[str, str]:
    """Parse text of `sources_to_text`."""
    pairs = (line.split("  ", 1) for line in text.splitlines() if "  " in line)
    return {path: digest for digest, path in pairs}


def source_changes(before: Mapping[str, str], now: Mapping[str, str]) -> tuple[str, ...]:
    """Return sentences on how picktree's sources differ between two results of `sources`; none when they are
    equal.

    A file with the same content at another path has moved. Where many paths are gone and many are new, the
    files were edited as they moved, and are counted with the others.
    """
    gone, new, _, edited = _moves(before, now)
    altered = [path for path, digest in before.items() if now.get(path, digest) != digest]
    if not edited:
        altered += [path for path, digest in gone.items() if digest not in new.values()]
        altered += [path for path, digest in new.items() if digest not in gone.values()]
    sentences = [moved] if (moved := moved_sources(before, now)) else []
    if altered:
        more = f" and {len(altered) - _MAX_NAMED_FILES} more" if len(altered) > _MAX_NAMED_FILES else ""
        sentences.append(
            f"picktree itself was changed in {', '.join(sorted(altered)[:_MAX_NAMED_FILES])}{more}"
        )
    return tuple(sentences)


def moved_sources(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return a sentence on the files of picktree that have moved; empty when none has."""
    _, _, same, edited = _moves(before, now)
    moved = same + edited
    if not moved:
        return ""
    one = "1 file was moved" if moved == 1 else f"{moved} files were moved"
    return (
        f"the source files have moved since the run ({one}{f', {edited} of them changed' if edited else ''})"
    )


def _moves(
    before: Mapping[str, str], now: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, str], int, int]:
    """Return the files that are gone, the new ones, and how many moved: unchanged, and edited on the way."""
    gone = {path: digest for path, digest in before.items() if path not in now}
    new = {path: digest for path, digest in now.items() if path not in before}
    same = (Counter(gone.values()) & Counter(new.values())).total()
    edited = min(len(gone), len(new)) - same
    return gone, new, same, edited if edited > _MAX_NAMED_FILES else 0


def _run_files() -> list[str]:
    left_out = {str(file_system.ROOT / name) for name in _FILES_WITHOUT_EFFECT}
    found = [str(file) for file in file_system.ROOT.glob("*.py")]
    for room in file_system.rooms():
        for folder, folders, files in os.walk(file_system.ROOT / room):
            if folder in left_out:
                folders.clear()
            else:
                found += [os.path.join(folder, name) for name in files if name.endswith((".py", ".yaml"))]
    present = [path for path in found if path not in left_out and os.path.isfile(path)]
    return sorted(present, key=lambda path: path.split(os.sep))


def _processor() -> tuple[str, str]:
    """Return the processor's model and its vector instructions."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or platform.machine(), ""
    pairs = (line.partition(":") for line in text.splitlines())
    words = {key.strip(): value.strip() for key, _, value in pairs}
    flags = (words.get("flags") or words.get("Features") or "").split()
    model = words.get("model name") or platform.processor() or platform.machine()
    return model, " ".join(sorted(flag for flag in flags if flag.startswith(_SIMD_PREFIXES)))

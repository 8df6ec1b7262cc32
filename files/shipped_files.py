"""Finding a file by the name of a shipped one, or by its path beside the file that names it."""

from __future__ import annotations

from functools import cache
from os import PathLike
from pathlib import Path
from typing import Final

from .errors import PicktreeError
from .value_wording import MOST_NEAR, suggest_name

ROOT: Final = Path(__file__).resolve().parent.parent
"""Folder of the package `picktree`. In a checkout it contains tests, examples and documents, too."""


EXAMPLES: Final = ROOT / "examples"
"""Shipped missions, with cases and faults in folders below."""


@cache
def rooms() -> tuple[str, ...]:
    """Names of the top-level packages, sorted. Only they have an `__init__.py`: tests and examples have
    none."""
    return tuple(sorted(file.parent.name for file in ROOT.glob("*/__init__.py")))


def find_file(name_or_path: str, folder: Path, beside: Path | None, what: str) -> Path:
    """`three_bins` is a shipped file of `folder`; anything with a suffix or a slash is a path.

    A path counts from `beside` (a file or its folder), else from the working directory. Raises PicktreeError.
    """
    at = beside.parent if beside is not None and not is_folder(beside) else beside
    if "\x00" in name_or_path or not name_or_path:
        raise PicktreeError(f"{name_or_path!r} is no name of a {what}")
    if "/" in name_or_path or name_or_path.endswith((".yaml", ".yml")):
        path = at / name_or_path if at is not None else Path(name_or_path)
        if not is_file(path):
            raise PicktreeError(f"there is no {what} file {path}")
        return path
    shipped = folder / f"{name_or_path}.yaml"
    if is_file(shipped):
        return shipped
    own = at / f"{name_or_path}.yaml" if at is not None else Path(f"{name_or_path}.yaml")
    if is_file(own):
        return own
    hint = suggest_name(name_or_path, shipped_names(folder))
    raise PicktreeError(f"unknown {what} {name_or_path!r}" + (f" ({hint})" if hint else ""))


def example_file(name_or_path: str | PathLike[str], folder: str = "", what: str = "mission") -> Path:
    """Return the file of a name or path that a person gave: `sort_by_colour` is a shipped example.

    `folder`: its folder below `EXAMPLES`. A file of that name in the working directory comes first. A text
    with a slash or a suffix is a path, which need not exist. Raises PicktreeError, with near names, for a
    name that is neither, also for one with the suffix .yaml.
    """
    found = known_file(name_or_path, folder)
    path = Path(name_or_path)
    if found is not None or path.suffix not in ("", ".yaml") or path.name != str(name_or_path):
        return found or path
    known = dict.fromkeys((*shipped_names(Path()), *shipped_names(EXAMPLES / folder)))
    hint = suggest_name(path.name.removesuffix(".yaml"), known, most=MOST_NEAR)
    if path.suffix and not hint.startswith("did"):
        return path
    raise PicktreeError(f"there is no {what} {str(path)!r}, neither a file here nor an example ({hint})")


def known_file(name_or_path: str | PathLike[str], folder: str = "") -> Path | None:
    """Return the file, folder or shipped example of a name or path; None when there is none."""
    path, file = Path(name_or_path), f"{name_or_path}.yaml"
    if is_file(path) or is_folder(path):
        return path
    own, example = Path(file), EXAMPLES / folder / file
    if path.suffix or path.name != str(name_or_path):
        return None
    return own if is_file(own) else example if is_file(example) else None


def is_file(path: Path) -> bool:
    """As `Path.is_file`, and False for what cannot be a path at all (too long, with a null byte)."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """As `Path.is_dir`, and False for what cannot be a path at all."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def shipped_names(folder: Path) -> tuple[str, ...]:
    """Names of the shipped files of a folder, sorted."""
    return tuple(sorted(path.stem for path in folder.glob("*.yaml")))

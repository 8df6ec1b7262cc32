"""Libraries that only some installations have, and tables for one of them, pandas."""

from __future__ import annotations

import shlex
import sys
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from picktree.files import PicktreeError

if TYPE_CHECKING:
    import pandas
    from numpy.typing import NDArray


@contextmanager
def optional_import(name: str, library: str, what: str) -> Generator[None]:
    """Turn a failed import of `library` into a PicktreeError that says how to add the extra.

    >>> with optional_import("video", "av", "A video"):  # doctest: +ELLIPSIS
    ...     raise ModuleNotFoundError("No module named 'av'", name="av")
    Traceback (most recent call last):
        ...
    picktree.files.errors.PicktreeError: A video needs the extra 'video': ... 'picktree[video]'
    """
    try:
        yield
    except ImportError as error:
        if error.name is None or error.name.split(".")[0] != library:
            raise
        raise PicktreeError(f"{what} needs the extra '{name}': {install_command(name)}") from None


def install_command(name: str) -> str:
    """Return the command that adds the extra to the environment in use.

    In a checkout it takes the versions that the checkout pins.
    """
    pins = Path(__file__).parents[1] / "constraints.txt"
    constraint = ["-c", _shown(pins)] if pins.is_file() else []
    return shlex.join(
        [_shown(Path(sys.executable)), "-m", "pip", "install", *constraint, f"picktree[{name}]"]
    )


def _shown(path: Path) -> str:
    """Return the path relative to the working directory if it is inside."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


class PandasTable(ABC):
    """Table that becomes a data frame: by `to_pandas()`, or as `pandas.DataFrame(table)`."""

    __slots__ = ()

    @abstractmethod
    def columns_by_name(self) -> Mapping[str, Sequence[object] | NDArray[Any]]:
        """Return the columns, each with one value a row."""

    def to_pandas(self) -> pandas.DataFrame:
        """Return the table as a data frame. Raises PicktreeError when pandas is missing."""
        with optional_import("pandas", "pandas", "A data frame"):
            import pandas

        return pandas.DataFrame(dict(self.columns_by_name()))

    def __iter__(self) -> Iterator[Mapping[str, object]]:
        """Return the rows, as `pandas.DataFrame` reads them."""
        columns = self.columns_by_name()
        return (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))

"""Tables for pandas: rows with named columns that `pandas.DataFrame` takes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .optional_libraries import optional_import

if TYPE_CHECKING:
    import pandas
    from numpy.typing import NDArray


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

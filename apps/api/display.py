"""Values that a notebook shows: pictures, drawings of trees, texts and tables."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from picktree.files import PicktreeError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from picktree.authoring import mission_chart


class SceneImage:
    """Picture of a scene: RGB pixels that a notebook shows and `save` writes as a PNG file."""

    def __init__(self, pixels: NDArray[np.uint8]) -> None:
        self.pixels = pixels
        """Colours (h, w, 3)."""

    def save(self, file: str | PathLike[str]) -> Path:
        """Write the picture as PNG and return its path. Raises PicktreeError when it cannot be written."""
        return _write(Path(file), self._repr_png_())

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        return f"<picture {width} × {height}>"

    def _repr_png_(self) -> bytes:
        import cv2

        written, data = cv2.imencode(".png", cv2.cvtColor(self.pixels, cv2.COLOR_RGB2BGR))
        assert written
        return data.tobytes()


class TreeDrawing:
    """Drawing of a mission's trees: SVG in a notebook, text in a terminal."""

    def __init__(self, chart: mission_chart.Chart, *, expand: bool) -> None:
        self._chart, self._expand = chart, expand

    def save(self, file: str | PathLike[str]) -> Path:
        """Write the drawing and return its path: a .svg, .html, .dot or .txt file.

        Raises PicktreeError for another suffix, and when the file cannot be written.
        """
        from picktree.authoring import drawing

        path = Path(file)
        text = drawing.drawing_text(self._chart, drawing.suffix_of(path.name), expand=self._expand)
        return _write(path, text.encode())

    def __repr__(self) -> str:
        from picktree.authoring import text

        return text(self._chart, expand=self._expand)

    def _repr_svg_(self) -> str:
        from picktree.authoring import svg

        return svg(self._chart, expand=self._expand)


class ReadableText(str):
    """Text that a notebook and a prompt show as it reads, line by line."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return preformatted(self)


def preformatted(text: str) -> str:
    """Return a text as HTML that keeps its lines."""
    return f"<pre>{html.escape(text)}</pre>"


def html_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as HTML."""
    titles = "".join(f"<th>{html.escape(title)}</th>" for title in head)
    body = "".join(
        f"<tr>{''.join(f'<td>{html.escape(str(value))}</td>' for value in row)}</tr>" for row in rows
    )
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>"


def _write(path: Path, data: bytes) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise PicktreeError(f"{path} cannot be written: {error.strerror}") from None
    return path

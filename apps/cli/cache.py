"""picktree cache"""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from .options import JsonAnswer
from .output import keep_stdout, print_answer


def cache(
    action: Annotated[
        Literal["clear"] | None, typer.Argument(metavar="clear", help="clear: delete all entries.")
    ] = None,
    json: JsonAnswer = False,
) -> None:
    """Print the folder of results that are kept between runs, such as robot meshes, their number and size."""
    from picktree.files import disk_cache

    answer = keep_stdout() if json else None
    content = disk_cache.cache_content() if action is None else disk_cache.clear_cache()
    print_answer(answer, lambda: content.to_text(cleared=action is not None), content.to_json_text)

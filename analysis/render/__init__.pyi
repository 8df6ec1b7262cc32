from .films import film as film
from .snapshots import snapshot as snapshot

# for other rooms
from .captions import Caption as Caption, CaptionFailure as CaptionFailure, write as write
from .films import FilmRequest as FilmRequest
from .rasterizer import Picture as Picture
from .scene_view import (
    SceneContent as SceneContent,
    SceneRenderer as SceneRenderer,
    bin_tints as bin_tints,
    body_mesh as body_mesh,
    heap_remark as heap_remark,
    part_colour as part_colour,
)
from .snapshots import draw as draw, draw_robot as draw_robot, home_mesh as home_mesh
from .viewpoint import PictureView as PictureView, parse_size as parse_size, parse_view as parse_view

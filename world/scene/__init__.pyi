from .description import (
    Bin as Bin,
    CatalogueEntry as CatalogueEntry,
    Fixture as Fixture,
    SceneDescription as SceneDescription,
)
from .scene_loading import load_scene as load_scene, parse_scene as parse_scene

# for other rooms
from . import destinations as destinations, scene_loading as scene_loading
from .description import (
    ASSORTMENT as ASSORTMENT,
    Assortment as Assortment,
    AtIntervals as AtIntervals,
    AtTimes as AtTimes,
    Belt as Belt,
    CameraDescription as CameraDescription,
    Delivery as Delivery,
    Form as Form,
    Hole as Hole,
    MAX_HIDDEN_SHARE as MAX_HIDDEN_SHARE,
    MESH_SETS as MESH_SETS,
    MIN_DETECTABLE_MASS as MIN_DETECTABLE_MASS,
    NO_UNCERTAINTY as NO_UNCERTAINTY,
    SafetyLimits as SafetyLimits,
    SensorNoise as SensorNoise,
    Spawn as Spawn,
    TILE_HEIGHT as TILE_HEIGHT,
    TargetTile as TargetTile,
    WhenClear as WhenClear,
    tile_body as tile_body,
)
from .feed_loading import MIN_BELT_GAP as MIN_BELT_GAP, SPACING_SPREAD as SPACING_SPREAD, reach as reach
from .scene_entries import check_unknown as check_unknown, hidden_body as hidden_body
from .scene_schema import SceneFile as SceneFile, UnknownFile as UnknownFile

// The panels, in the order in which they stand. `wide`: in the wide column of a large screen.

import { Board } from "./board.js";
import { Events } from "./events.js";
import { Failures } from "./failures.js";
import { Images } from "./images.js";
import { Lanes } from "./lanes.js";
import { Plots } from "./plots.js";
import { Stage } from "./stage.js";
import { Tree } from "./tree.js";

export const PANELS = [
  { name: "stage", title: "Scene", wide: true, Panel: Stage },
  { name: "failures", title: "Failures", Panel: Failures },
  { name: "lanes", title: "Lanes", wide: true, Panel: Lanes },
  { name: "tree", title: "Tree", wide: true, Panel: Tree },
  { name: "board", title: "Belief and blackboard", wide: true, Panel: Board },
  { name: "images", title: "Camera", Panel: Images },
  { name: "events", title: "Events", Panel: Events },
  { name: "plots", title: "Plots", Panel: Plots },
];

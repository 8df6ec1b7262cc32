// The panels, in the order in which they stand. `wide`: in the wide column of a large screen.

import { Stage } from "./stage.js";

export const PANELS = [{ name: "stage", title: "Scene", wide: true, Panel: Stage }];

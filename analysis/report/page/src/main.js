// The page of one run. How its parts meet:
//
// A panel is a class in a file of its own, named in panels.js:
//
//     export class Lanes {
//       constructor(host, section, player, tools) {}
//     }
//
// `host` is an empty element of the panel's width, in which the panel lays itself out (it asks for a height by
// its own style sheet, which it imports: `import "./lanes.css"`); `section` is what python packed for it
// (`Section(name, data)`, arrays as typed arrays with a `shape`); `tools` is an element in the panel's title
// bar for its buttons. A panel that is collapsed or in a tab behind has no size: use a ResizeObserver. Where
// data is {"empty": sentence}, the shell shows the sentence and makes no panel.
//
// `player` (player.js) is what all share: the time, the chosen node, the chosen failure. Colours come from
// the style sheet's variables (theme.js), which change when the reader switches between light and dark.

import "./page.css";

import { Bar } from "./bar.js";
import { Head } from "./head.js";
import { Host } from "./host.js";
import { Keys } from "./keys.js";
import { Links } from "./links.js";
import { PANELS } from "./panels.js";
import { Player } from "./player.js";
import { Shell } from "./shell.js";
import { startTheme } from "./theme.js";
import { unpack } from "./unpacking.js";

async function start() {
  startTheme();
  const sections = await unpack(document.getElementById("payload").textContent);
  const player = new Player(sections.run);
  new Head(document.getElementById("head"), sections.run, player);
  new Bar(document.getElementById("bar"), sections.run, player);
  const shell = new Shell(document.getElementById("panels"), PANELS, sections, player);
  new Keys(player);
  new Links(player);
  new Host(player);
  player.start();
  // For tests and for the curious at the console.
  globalThis.picktreeReport = { player, shell, sections };
  document.documentElement.dataset.ready = "yes";
}

start().catch((error) => {
  console.error(error);
  const said = document.getElementById("problem");
  said.hidden = false;
  said.textContent = `This report cannot be shown: ${error.message ?? error}`;
});

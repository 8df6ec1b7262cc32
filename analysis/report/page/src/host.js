// The page that shows this report in a frame, if there is one: it is told each moment, and may choose one.
//
//   to it     {picktree: "moment", time, tick, node, failure}
//   from it   {picktree: "go", time, failure, theme}, each of the three where it is wanted

import { setTheme } from "./theme.js";

const PAUSE = 150; // ms without a move after which the moment is told

export class Host {
  constructor(player) {
    if (parent === globalThis) return;
    this.player = player;
    document.documentElement.dataset.framed = "yes";
    addEventListener("message", (event) => {
      if (event.source === parent && event.data?.picktree === "go") this.go(event.data);
    });
    for (const on of ["onTime", "onFailure", "onSelect"]) player[on](() => this.later());
  }

  go({ time, failure, theme }) {
    if (theme === "dark" || theme === "light") setTheme(theme);
    if (Number.isInteger(failure)) this.player.selectFailure(failure);
    if (Number.isFinite(time)) {
      this.player.pause();
      this.player.seek(time);
    }
  }

  later() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      const { time, tick, node, failure } = this.player;
      parent.postMessage({ picktree: "moment", time, tick, node, failure }, "*");
    }, PAUSE);
  }
}

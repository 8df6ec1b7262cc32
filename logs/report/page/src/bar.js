// The player's bar: buttons, the scrubber with its marks, time and tick.

import { faster, SPEEDS } from "./keys.js";
import { hashOf } from "./links.js";
import { made } from "./made.js";

export class Bar {
  constructor(element, run, player) {
    this.player = player;
    const button = (id, icon, title, onclick) =>
      made("button", { id, class: "icon", title, "aria-label": title.replace(/ \(.*/, ""), onclick }, icon);
    this.play = button("play", "▶", "Play ( Space )", () => player.toggle());
    this.speed = made(
      "select",
      { id: "speed", title: "Speed ( + − )", "aria-label": "Speed", onchange: () => player.setSpeed(Number(this.speed.value)) },
      ...SPEEDS.map((speed) => made("option", { value: speed }, `${speed}×`)),
    );
    this.range = made("input", {
      id: "scrub", type: "range", min: 0, max: player.times.length - 1, step: 1, "aria-label": "Time",
      oninput: () => { player.pause(); player.seekTick(Number(this.range.value)); },
    });
    this.marks = made("div", { class: "marks", "aria-hidden": "true" });
    this.clock = made("output", { id: "clock" });
    this.number = made("span", { id: "tick" });
    element.append(
      made("div", { class: "scrubber" }, this.marks, this.range),
      made("div", { class: "buttons" },
        button("failure-before", "⏮", "Previous failure ( p )", () => player.stepFailure(-1)),
        button("tick-before", "◂", "One tick back ( ← )", () => { player.pause(); player.step(-1); }),
        this.play,
        button("tick-after", "▸", "One tick on ( → )", () => { player.pause(); player.step(1); }),
        button("failure-after", "⏭", "Next failure ( n )", () => player.stepFailure(1)),
        this.speed,
        made("span", { class: "space" }),
        made("span", { class: "when" }, this.clock, this.number),
        button("link", "🔗", "Copy a link to this tick", () => this.copy()),
      ),
    );
    this.mark(run);
    player.onTime((time, tick) => this.show(time, tick));
    player.onPlay((playing, speed) => {
      this.play.textContent = playing ? "⏸" : "▶";
      this.play.setAttribute("aria-label", playing ? "Pause" : "Play");
      this.speed.value = speed;
    });
  }
  show(time, tick) {
    this.range.value = tick;
    this.clock.textContent = `${time.toFixed(2)} s`;
    this.number.textContent = `tick ${tick}`;
  }
  mark() {}
  async copy() {
    await navigator.clipboard?.writeText(location.href.split("#")[0] + hashOf(this.player));
  }
}

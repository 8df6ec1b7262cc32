// The player's bar: buttons, the scrubber with its marks, time and tick.

import { icon } from "./icons.js";
import { SPEEDS } from "./keys.js";
import { hashOf } from "./links.js";
import { made } from "./made.js";

const NEAR = 7; // pixels within which a click on the scrubber means a failure's mark
const THUMB = 8; // half of the scrubber's thumb: its middle stops so far from the ends

export class Bar {
  constructor(element, run, player) {
    this.player = player;
    this.run = run;
    const one = (direction) => () => {
      player.pause();
      player.step(direction);
    };
    this.play = button("play", "play", "Play (Space)", () => player.toggle());
    this.speed = made(
      "select",
      { id: "speed", title: "Speed (− +)", "aria-label": "Speed", onchange: () => player.setSpeed(Number(this.speed.value)) },
      ...SPEEDS.map((speed) => made("option", { value: speed }, `${speed}×`)),
    );
    this.clock = made("output", { id: "clock", "aria-label": "Simulated time" });
    this.number = made("span", { id: "tick" });
    this.link = button("link", "link", "Copy a link to this tick", () => this.copy());
    const failures = player.failures.length > 0;
    const before = button("failure-before", "failureBefore", "Previous failure (p)", () => player.stepFailure(-1), failures);
    const after = button("failure-after", "failureAfter", "Next failure (n)", () => player.stepFailure(1), failures);
    element.append(
      made("div", { class: "buttons" }, before, button("tick-before", "back", "One tick back (←)", one(-1)), this.play,
        button("tick-after", "on", "One tick on (→)", one(1)), after, this.speed,
        made("span", { class: "when" }, this.clock, this.number)),
      this.scrubber(),
      this.link,
    );
    // On a phone the scrubber stands above the buttons.
    const small = matchMedia("(max-width: 760px)");
    const arrange = () => {
      const when = element.querySelector(".when");
      if (small.matches) {
        element.prepend(element.querySelector(".scrubber"));
        element.querySelector(".buttons").append(when);
      } else element.append(element.querySelector(".scrubber"), when, this.link);
    };
    small.addEventListener("change", arrange);
    arrange();
    player.onTime((time, tick) => this.show(time, tick));
    player.onPlay((playing, speed) => this.state(playing, speed));
    player.onFailure((number) => this.choose(number));
  }

  scrubber() {
    const { player } = this;
    this.range = made("input", {
      id: "scrub", type: "range", min: player.begin, max: player.end, step: "any", "aria-label": "Time",
      oninput: () => {
        player.pause();
        player.seek(Number(this.range.value));
      },
    });
    this.marks = made("div", { class: "marks", "aria-hidden": "true" });
    this.past = made("div", { class: "past" });
    this.bubble = made("div", { class: "bubble", hidden: true });
    this.mark();
    const holder = made("div", { class: "scrubber" }, this.past, this.marks, this.range, this.bubble);
    this.range.addEventListener("pointermove", (event) => this.hint(event));
    this.range.addEventListener("pointerleave", () => (this.bubble.hidden = true));
    this.range.addEventListener("click", (event) => {
      const number = this.near(event);
      if (number !== null) player.selectFailure(number);
    });
    return holder;
  }

  mark() {
    const place = (time) => `${(this.share(time) * 100).toFixed(3)}%`;
    const put = (kind, time) => {
      const found = made("i", { class: kind });
      found.style.left = place(time);
      this.marks.append(found);
      return found;
    };
    for (const { time } of this.run.done) put("mark-done", time);
    for (const { time } of this.run.faults) put("mark-fault", time);
    this.failures = this.player.failures.map(({ time, fate }) => put(`mark-failure mark-${fate}`, time));
  }

  share(time) {
    const { begin, end } = this.player;
    return end > begin ? (time - begin) / (end - begin) : 0;
  }

  show(time, tick) {
    this.range.value = time;
    this.range.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds, tick ${tick}`);
    const share = this.share(time);
    this.past.style.width = `calc(${THUMB}px + (100% - ${2 * THUMB}px) * ${share.toFixed(5)})`;
    this.clock.textContent = `${time.toFixed(2)} s`;
    this.number.textContent = `tick ${tick}`;
  }

  state(playing, speed) {
    this.play.replaceChildren(icon(playing ? "pause" : "play"));
    this.play.title = playing ? "Pause (Space)" : "Play (Space)";
    this.play.setAttribute("aria-label", playing ? "Pause" : "Play");
    this.speed.value = speed;
  }

  choose(number) {
    this.failures.forEach((mark, k) => mark.classList.toggle("mark-chosen", k === number));
  }

  // The time under the pointer, and what happened there.
  hint(event) {
    const { x, time } = this.under(event);
    const number = this.near(event);
    const words = [`${time.toFixed(2)} s`];
    if (number !== null) {
      const { node, cause, item } = this.player.failures[number];
      words.push(cause, [node.split("/").at(-1), item].filter(Boolean).join(" of "));
    } else {
      const near = [...this.run.done, ...this.run.faults].find((one) => Math.abs(this.x(one.time) - x) < 4);
      if (near) words.push(near.label);
    }
    this.bubble.textContent = words.join(" · ");
    this.bubble.hidden = false;
    const half = this.bubble.offsetWidth / 2;
    const bar = this.range.getBoundingClientRect();
    const middle = Math.min(Math.max(bar.left + x, half + 4), innerWidth - half - 4) - bar.left;
    this.bubble.style.left = `${middle}px`;
  }

  x(time) {
    return THUMB + (this.range.clientWidth - 2 * THUMB) * this.share(time);
  }

  under(event) {
    const { left, width } = this.range.getBoundingClientRect();
    const x = event.clientX - left;
    const share = Math.min(Math.max((x - THUMB) / (width - 2 * THUMB), 0), 1);
    const { begin, end } = this.player;
    return { x, time: begin + share * (end - begin) };
  }

  // The failure whose mark is under the pointer, or null.
  near(event) {
    const { x } = this.under(event);
    let [found, least] = [null, NEAR];
    this.player.failures.forEach(({ time }, number) => {
      const apart = Math.abs(this.x(time) - x);
      if (apart < least) [found, least] = [number, apart];
    });
    return found;
  }

  async copy() {
    const address = location.href.split("#")[0] + hashOf(this.player);
    history.replaceState(null, "", hashOf(this.player));
    try {
      await navigator.clipboard.writeText(address);
      this.link.replaceChildren(icon("done"));
    } catch {
      // Browsers that do not let a file write to the clipboard show it for copying.
      prompt("Link to this tick", address);
    }
    setTimeout(() => this.link.replaceChildren(icon("link")), 1500);
  }
}

function button(id, name, title, onclick, enabled = true) {
  const label = title.replace(/ \(.*/, "");
  return made("button", { id, class: "icon", title, "aria-label": label, onclick, disabled: !enabled }, icon(name));
}

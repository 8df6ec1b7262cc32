// Everything that happened, as a list that goes along with the time.

import "./events.css";

import { made } from "./made.js";
import { onShown } from "./scrolling.js";
import { recall, remember } from "./theme.js";
import { shortened } from "./words.js";

const QUIET = new Set(["belief", "plan", "checkpoint"]); // kinds that are left out until they are asked for
const BAD = new Set(["failure", "no plan", "safety_stop"]);

export class Events {
  constructor(host, section, player, tools) {
    Object.assign(this, { section, player, present: -1 });
    host.classList.add("events");
    const { kind, words } = section;
    const counts = new Map();
    for (const number of kind) counts.set(words[number], (counts.get(words[number]) ?? 0) + 1);
    const kept = recall("events");
    this.off = kept === null ? QUIET : new Set(kept.split(" ").filter(Boolean).map((name) => name.replace("+", " ")));
    this.chips = made("div", { class: "events-chips", role: "group", "aria-label": "Kinds of events" },
      ...[...counts].sort(([a], [b]) => a.localeCompare(b)).map(([name, count]) => this.chip(name, count)));
    this.rows = Array.from(section.time, (time, row) => this.row(time, row));
    this.list = made("ol", { class: "events-list", "aria-label": "Events" }, ...this.rows);
    host.append(this.chips, this.list);
    this.count = made("span", { class: "failures-count" });
    tools.append(this.count);
    this.filter();
    onShown(host, () => this.centre());
    player.onTick(() => this.at());
  }

  chip(name, count) {
    const chip = made("button", { class: "chip", "aria-pressed": String(!this.off.has(name)) }, `${name.replace("_", " ")} ${count}`);
    chip.addEventListener("click", () => {
      this.off = new Set(this.off);
      if (!this.off.delete(name)) this.off.add(name);
      chip.setAttribute("aria-pressed", String(!this.off.has(name)));
      remember("events", [...this.off].map((one) => one.replace(" ", "+")).join(" "));
      this.filter();
    });
    return chip;
  }

  row(time, row) {
    const { section, player } = this;
    const kind = section.words[section.kind[row]];
    const node = section.words[section.node[row]];
    const go = () => {
      player.pause();
      player.seek(time);
      if (node) player.selectNode(node);
    };
    return made("li", { "data-kind": kind, class: BAD.has(kind) ? "bad" : kind === "fault" ? "planted" : "" },
      made("button", { onclick: go, title: node },
        made("time", {}, time.toFixed(2)),
        made("span", { class: "kind" }, kind.replace("_", " ")),
        made("span", { class: "text" }, shortened(section.words[section.text[row]]))));
  }

  filter() {
    let count = 0;
    for (const row of this.rows) {
      row.hidden = this.off.has(row.dataset.kind);
      if (!row.hidden) count += 1;
    }
    this.count.textContent = `${count} of ${this.rows.length}`;
    this.present = -2;
    this.at();
  }

  centre() {
    const row = this.rows[this.present];
    if (this.list.clientHeight) this.list.scrollTop = row ? row.offsetTop - this.list.clientHeight / 2 : 0;
  }

  // The last event until now.
  at() {
    const { time } = this.section;
    let [low, high] = [0, time.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time[middle] <= this.player.time + 1e-6) low = middle + 1;
      else high = middle;
    }
    let present = low - 1;
    while (present >= 0 && this.rows[present].hidden) present -= 1;
    if (present === this.present) return;
    this.rows[this.present]?.classList.remove("present");
    this.present = present;
    this.rows[present]?.classList.add("present");
    this.centre();
  }
}

// The behaviour tree drawn as a tree, with the status of each node at the present tick.

import "./tree.css";

import { made } from "./made.js";
import { Tip } from "./tip.js";

/* global PicktreeDrawing -- authoring/drawing/page/viewer.js, a script before this one */

const LEAST = 0.6; // scale at which a whole tree is shown rather than a part of it
const MOST = 0.8; // scale at which what runs is followed

export class Tree {
  constructor(host, section, player, tools) {
    Object.assign(this, { host, section, player, drawings: new Map(), shown: null, tick: -1, tip: "" });
    this.numbers = new Map(section.paths.map((path, number) => [path, number]));
    this.ticks = section.statuses.shape[1];
    this.note = made("p", { class: "tree-note", hidden: true });
    this.sheet = made("div", { class: "tree-sheet" });
    host.classList.add("tree");
    host.append(this.note, this.sheet);
    this.hint = new Tip(host);
    this.tools(tools);
    // A drawing needs to know its size before it can be made.
    new ResizeObserver(() => this.ready()).observe(this.sheet);
    player.onTick((tick) => this.at(tick));
    player.onSelect((path) => this.choose(path));
  }

  tools(tools) {
    const button = (text, title, action) =>
      made("button", { class: "chip", title, "aria-label": title, onclick: () => this.drawing && action(this.drawing) }, text);
    this.follows = made("button", {
      class: "chip", "aria-pressed": "true", title: "Keep the running nodes in view",
      onclick: () => {
        this.following = !this.following;
        this.follows.setAttribute("aria-pressed", String(this.following));
        this.tipPath = "";
        this.at(this.player.tick);
      },
    }, "Follow");
    this.following = true;
    tools.append(
      this.follows,
      button("⊞", "Open all sub-trees", (drawing) => drawing.openAll(true)),
      button("⊟", "Close all sub-trees", (drawing) => { drawing.openAll(false); this.unfollow(); }),
      button("−", "Smaller", (drawing) => drawing.scaleBy(1 / 1.3)),
      button("+", "Larger", (drawing) => drawing.scaleBy(1.3)),
      button("Fit", "Show the whole tree", (drawing) => { drawing.fit(); this.unfollow(); }),
    );
  }

  unfollow() {
    this.following = false;
    this.follows.setAttribute("aria-pressed", "false");
  }

  ready() {
    const { width, height } = this.sheet.getBoundingClientRect();
    if (width < 40 || height < 40) return;
    this.wide = true;
    this.at(this.player.tick);
  }

  // The chart of the mission that ran at a time; edits under the run make others.
  chartAt(time) {
    const { charts } = this.section;
    const place = charts.findLastIndex(({ since }) => since <= time + 1e-6);
    return Math.max(place, 0);
  }

  at(tick) {
    if (!this.wide) return;
    this.turn(this.chartAt(this.player.times[tick]));
    if (tick === this.tick) return;
    this.tick = tick;
    const { statuses, words, paths } = this.section;
    const found = {};
    let tip = "";
    let failing = "";
    for (let number = 0; number < paths.length; number += 1) {
      const status = words[statuses[number * this.ticks + tick]];
      if (!status || status === "IDLE") continue;
      found[paths[number]] = status;
      if (status === "RUNNING" && depth(paths[number]) > depth(tip)) tip = paths[number];
      if (status === "FAILURE" && depth(paths[number]) > depth(failing)) failing = paths[number];
    }
    const key = JSON.stringify(found);
    if (key !== this.key) {
      this.key = key;
      this.drawing.setStatuses(found);
    }
    const wanted = failing && depth(failing) > depth(tip) ? failing : tip || failing;
    if (this.following && wanted && wanted !== this.tipPath) {
      this.tipPath = wanted;
      this.look(wanted);
    }
  }

  // Brings a node into the middle, in a size that can be read, where the whole has no room.
  look(path) {
    const { drawing } = this;
    const item = drawing.reveal(path);
    if (!item) return;
    const { width, height } = drawing.space;
    const whole = Math.min((width - 24) / drawing.root.width, (height - 24) / drawing.root.height);
    if (whole >= LEAST) drawing.fit();
    else {
      if (drawing.transform.k > MOST) drawing.scaleBy(MOST / drawing.transform.k);
      drawing.look(item);
    }
  }

  // Shows the drawing of that chart, made when it is first needed.
  turn(place) {
    if (this.shown === place) return;
    this.shown = place;
    this.tick = -1;
    this.key = this.tipPath = "";
    for (const [other, { sheet }] of this.drawings) sheet.hidden = other !== place;
    if (!this.drawings.has(place)) this.drawings.set(place, this.draw(place));
    this.drawing = this.drawings.get(place).drawing;
    const { since } = this.section.charts[place];
    this.note.hidden = this.section.charts.length < 2;
    this.note.textContent = place ? `As edited during the run, from ${since.toFixed(2)} s on` : "As at the start of the run; the mission is edited later";
    this.choose(this.player.node);
  }

  draw(place) {
    const sheet = made("div", { class: "tree-drawing" });
    this.sheet.append(sheet);
    const drawing = new PicktreeDrawing(sheet, this.section.charts[place].chart);
    drawing.onselect = (item) => {
      if (this.telling) return;
      this.player.selectNode(item.path);
    };
    drawing.svg.addEventListener("pointermove", (event) => this.hover(drawing, event));
    for (const gone of ["pointerleave", "pointerdown", "wheel"]) {
      drawing.svg.addEventListener(gone, () => this.hint.hide(), { passive: true });
    }
    return { sheet, drawing };
  }

  choose(path) {
    if (!this.drawing || path === null || !this.drawing.root.find(path)) return;
    if (this.drawing.chosen && this.drawing.selected === path) return;
    this.telling = true;
    this.drawing.select(path);
    this.telling = false;
  }

  hover(drawing, event) {
    const item = event.pointerType === "mouse" && !event.buttons ? drawing.itemAt(event.target) : null;
    if (!item || event.target.closest(".sheet")) this.hint.hide();
    else this.hint.show(card(item, drawing.statuses[item.path]), event);
  }
}

function depth(path) {
  return path ? path.split("/").length : 0;
}

// What the mission says of a node.
function card({ node }, status) {
  const rows = [...node.ports, ...node.before, ...node.after].flatMap(({ key, value, role }) => [
    made("dt", {}, key),
    made("dd", { class: "mono" }, `${role === "output" ? "→ " : ""}${value}`),
  ]);
  return [
    made("p", { class: "tip-head" }, made("b", {}, node.title), ` ${node.meaning}`),
    ...(status ? [made("p", { class: `tip-outcome ${status.toLowerCase()}` }, status)] : []),
    ...(node.doc ? [made("p", {}, node.doc.split("\n\n")[0])] : []),
    ...(rows.length ? [made("dl", { class: "pairs" }, ...rows)] : []),
    ...(node.causes.length ? [made("p", { class: "tip-time" }, `may fail with ${node.causes.join(", ")}`)] : []),
  ];
}

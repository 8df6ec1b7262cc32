// Lanes: what each node did over time, beneath a band of items, failures and recoveries.

import "./lanes.css";

import { Details } from "./details.js";
import { made } from "./made.js";
import { BAND, Paint, ROW } from "./painting.js";
import { Rows } from "./rows.js";
import { onShown } from "./scrolling.js";
import { Span } from "./span.js";
import { onTheme } from "./theme.js";
import { Tip } from "./tip.js";
import { Visits } from "./visits.js";
import { called, markWords, visitCard } from "./words.js";

const LEGEND = [["success", "success"], ["failure", "failure"], ["running", "still running"], ["muted", "halted"], ["skipped", "skipped"]];
const SIGNS = [
  ["▼", "failure", "failure that ended something"], ["▼", "cure_rim", "passed over"], ["▼", "success", "cured"],
  ["✚", "cure_rim", "recovery"], ["●", "success", "item done"], ["◆", "output", "fault planted"],
];

const SMALL = matchMedia("(max-width: 760px)");

export class Lanes {
  constructor(host, section, player, tools) {
    this.player = player;
    this.section = section;
    this.visits = new Visits(section, player.times);
    this.rows = new Rows(this.visits);
    this.rows.list = [];
    this.span = new Span(player.begin, player.end, () => this.later());
    this.paint = new Paint();
    this.hover = -1;
    this.selected = -1;
    this.lines = new Map();
    this.build(host, tools);
    this.tip = new Tip(host);
    this.details = new Details(this.detailsBox, this.visits, player, (i) => this.show(i));
    if (this.rows.failed.every((one) => !one) && !this.visits.count) this.rows.filter = "all";
    this.arrange();
    this.listen();
    onTheme(() => {
      this.paint.refresh();
      this.later();
    });
    new ResizeObserver(() => this.later()).observe(this.scroller);
    onShown(host, () => this.selected >= 0 && this.bring(this.rows.list.indexOf(this.selected)));
    player.onTime((time) => this.follow(time));
    player.onTick((tick) => this.dots(tick));
    player.onSelect((path) => this.choose(path));
    player.onFailure((failure) => {
      this.failure = failure;
      if (failure !== null) this.span.follow(player.failures[failure].time);
      this.later();
    });
  }

  build(host, tools) {
    const { section } = this;
    const button = (text, title, onclick) => made("button", { title, "aria-label": title, onclick }, text);
    this.search = made("input", { type: "search", placeholder: "Find a node", "aria-label": "Find a node", class: "lanes-search" });
    this.filter = made(
      "select",
      { "aria-label": "Which nodes", title: "Which nodes" },
      ...[["ran", "that ran"], ["failed", "that failed"], ["all", "all nodes"]].map(([value, text]) => made("option", { value }, text)),
    );
    tools.append(
      this.search,
      this.filter,
      button("⊞", "Open all", () => this.openAll(true)),
      button("⊟", "Close all", () => this.openAll(false)),
      button("−", "Show more time", () => this.span.zoom(1.6)),
      button("+", "Show less time", () => this.zoomIn()),
      button("↔", "Show the whole run", () => this.span.set(this.span.begin, this.span.end)),
    );
    this.names = made("div", { class: "lanes-names", role: "tree", "aria-label": "Nodes" });
    this.canvas = made("canvas", { class: "lanes-canvas", "aria-hidden": "true" });
    this.scroller = made("div", { class: "lanes-scroll" }, this.names, made("div", { class: "lanes-sheet" }, this.canvas));
    this.bandCanvas = made("canvas", {
      class: "lanes-band", role: "img",
      "aria-label": `${section.items.length} items worked on, ${this.player.failures.length} failures`,
    });
    this.cursor = made("div", { class: "lanes-cursor", "aria-hidden": "true" });
    this.none = made("p", { class: "lanes-none", hidden: true }, "No node fits.");
    this.detailsBox = made("div", { class: "lanes-details" });
    const colour = (name) => `color:var(--${name})`;
    host.classList.add("lanes");
    host.append(
      made("div", { class: "lanes-grid" },
        made("div", { class: "lanes-corner" }, made("span", {}, "item"), made("span", {}, "events"), made("span", {}, "time")),
        this.bandCanvas, this.scroller, this.cursor, this.none,
      ),
      made("p", { class: "lanes-legend" },
        ...LEGEND.map(([name, text]) => made("span", {}, made("i", { style: `background:var(--${name})` }), text)),
        ...SIGNS.map(([sign, name, text]) => made("span", {}, made("b", { style: colour(name) }, sign), text)),
        made("span", { class: "lanes-hint" }, "drag to move, ctrl + wheel or two fingers to zoom"),
      ),
      this.detailsBox,
    );
  }

  // Rows.

  arrange() {
    const { rows, visits, names } = this;
    this.filter.value = rows.filter;
    rows.list = rows.shown();
    this.lines.clear();
    names.replaceChildren(...rows.list.map((number) => this.line(number)));
    names.parentElement.style.setProperty("--rows", rows.list.length);
    // However deep a node is, its name has room.
    names.style.setProperty("--deepest", Math.max(...rows.list.map((number) => rows.depth[number]), 1));
    this.none.hidden = rows.list.length > 0;
    if (this.selected < 0 || !this.lines.has(this.selected)) this.reach(rows.list[0]);
    else this.reach(this.selected);
    this.dots(this.player.tick);
    this.later();
    return visits;
  }

  line(number) {
    const { rows, visits } = this;
    const { leaf } = rows.nodes[number];
    const opens = rows.below[number].length > 0;
    const failures = visits.failing[number].filter((i) => visits.failedItself(i)).length;
    const line = made(
      "div",
      {
        class: `lanes-name${leaf ? " leaf" : ""}${visits.byNode[number].length ? "" : " idle"}${rows.hits?.has(number) ? " hit" : ""}`,
        role: "treeitem", "aria-level": rows.depth[number] + 1, "aria-selected": String(number === this.selected),
        "aria-expanded": opens ? String(rows.isOpen(number)) : null, tabindex: "-1", title: rows.nodes[number].path,
        style: `--depth:${rows.depth[number]}`,
      },
      opens
        ? made("span", { class: "twisty", onclick: (event) => { event.stopPropagation(); this.toggle(number); } }, rows.isOpen(number) ? "▾" : "▸")
        : made("span", { class: "twisty" }),
      made("i", { class: "dot" }),
      made("span", { class: "said" }, ...called(rows.nodes[number])),
      failures ? made("span", { class: "count", title: `${failures} failure${failures > 1 ? "s" : ""}` }, `${failures}`) : null,
    );
    line.classList.toggle("selected", number === this.selected);
    line.addEventListener("click", () => this.player.selectNode(rows.nodes[number].path));
    line.addEventListener("dblclick", () => this.toggle(number));
    this.lines.set(number, line);
    return line;
  }

  toggle(number) {
    this.rows.toggle(number);
    this.arrange();
    this.lines.get(number)?.focus({ preventScroll: true });
  }

  openAll(open) {
    this.rows.openAll(open);
    this.arrange();
  }

  // The dots beside the names: the status of each node now.
  dots(tick) {
    for (const [number, line] of this.lines) {
      const status = this.visits.status(number, tick).toLowerCase();
      if (line.dataset.status !== status) line.dataset.status = status;
    }
    this.details?.show(tick);
  }

  // The one row that the tab key reaches.
  reach(number) {
    for (const [other, line] of this.lines) line.tabIndex = other === number ? 0 : -1;
  }

  choose(path) {
    const number = path === null ? -1 : this.visits.numbers.get(path) ?? -1;
    this.lines.get(this.selected)?.classList.remove("selected");
    this.lines.get(this.selected)?.setAttribute("aria-selected", "false");
    this.selected = number;
    if (number >= 0 && !this.lines.has(number)) {
      this.rows.reveal(number);
      if (!this.rows.words.length) this.search.value = "";
      this.arrange();
    }
    const line = this.lines.get(number);
    if (line) {
      line.classList.add("selected");
      line.setAttribute("aria-selected", "true");
      this.reach(number);
      this.bring(this.rows.list.indexOf(number));
    }
    this.details.choose(number);
    this.later();
  }

  // Scrolls the lanes, not the page, when a row is out of sight: of them, or of what they stand in.
  bring(row) {
    const { scroller } = this;
    const top = row * ROW;
    const box = scroller.getBoundingClientRect();
    let [upper, lower] = [box.top, box.top + scroller.clientHeight];
    for (let above = scroller.parentElement; above; above = above.parentElement) {
      if (getComputedStyle(above).overflowY === "visible") continue;
      const around = above.getBoundingClientRect();
      [upper, lower] = [Math.max(upper, around.top), Math.min(lower, around.bottom)];
    }
    if (lower - upper < 3 * ROW) [upper, lower] = [box.top, box.top + scroller.clientHeight];
    const at = box.top + top - scroller.scrollTop;
    if (at < upper || at + ROW > lower) scroller.scrollTop = top - ((upper + lower - ROW) / 2 - box.top);
    // On a small screen the panel itself scrolls, too.
    if (SMALL.matches) this.lines.get(this.rows.list[row])?.scrollIntoView({ block: "nearest" });
  }

  // A visit: its time in sight, its node chosen.
  show(i) {
    const { player, visits, span } = this;
    player.pause();
    player.seek(visits.start(i));
    span.follow(player.time);
    player.selectNode(visits.nodes[visits.columns.node[i]].path);
  }

  zoomIn() {
    const x = this.span.x(this.player.time);
    this.span.zoom(1 / 1.6, x >= 0 && x <= this.span.width ? x : undefined);
  }

  // What the reader does.

  listen() {
    const { names, player, rows } = this;
    this.search.addEventListener("input", () => {
      rows.search(this.search.value);
      this.arrange();
    });
    this.search.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && rows.hits?.size) player.selectNode(rows.nodes[[...rows.hits][0]].path);
      if (event.key !== "Escape") return;
      this.search.value = "";
      rows.search("");
      this.arrange();
    });
    this.filter.addEventListener("change", () => {
      rows.filter = this.filter.value;
      this.arrange();
    });
    names.addEventListener("keydown", (event) => this.key(event));
    this.scroller.addEventListener("scroll", () => this.later());
    this.span.listen(this.canvas, { ontap: (x, y, event) => this.tap(x, y, event) });
    this.span.listen(this.bandCanvas, { ontap: (x, y, event) => this.tapBand(x, y, event), wheelZooms: true });
    const over = (event, tell) => {
      if (event.pointerType === "mouse" && !event.buttons) tell(event.offsetX, event.offsetY, event);
    };
    this.canvas.addEventListener("pointermove", (event) => over(event, (x, y) => this.tell(x, y, event)));
    this.bandCanvas.addEventListener("pointermove", (event) => over(event, (x, y) => this.tellBand(x, y, event)));
    for (const canvas of [this.canvas, this.bandCanvas]) {
      canvas.addEventListener("pointerleave", (event) => {
        if (event.pointerType !== "mouse") return;
        this.tip.hide();
        this.mark(-1);
      });
    }
    this.canvas.addEventListener("dblclick", (event) => {
      const i = this.visitAt(event.offsetX, event.offsetY);
      if (i < 0) return;
      const room = Math.max(this.visits.until(i) - this.visits.start(i), 1) * 0.15;
      this.span.set(this.visits.start(i) - room, this.visits.until(i) + room);
    });
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { rows, player } = this;
    const row = rows.list.findIndex((number) => this.lines.get(number) === document.activeElement);
    const number = rows.list[row];
    if (number === undefined) return;
    const go = (to) => {
      if (to === undefined || to < 0) return;
      player.selectNode(rows.nodes[to].path);
      this.lines.get(to)?.focus({ preventScroll: true });
    };
    const opens = rows.below[number].length > 0;
    const actions = {
      ArrowDown: () => go(rows.list[row + 1]),
      ArrowUp: () => go(rows.list[row - 1]),
      ArrowRight: () => (opens && !rows.isOpen(number) ? this.toggle(number) : opens ? go(rows.list[row + 1]) : null),
      ArrowLeft: () => (opens && rows.isOpen(number) ? this.toggle(number) : go(rows.nodes[number].parent)),
      Home: () => go(rows.list[0]),
      End: () => go(rows.list.at(-1)),
      Enter: () => go(number),
      " ": () => this.toggle(number),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    event.stopPropagation();
    action();
  }

  visitAt(x, y) {
    const { visits, span } = this;
    const node = this.nodeAt(y);
    if (node < 0) return -1;
    const own = visits.byNode[node];
    const reach = 3 * ((span.to - span.from) / span.width);
    const time = span.time(x);
    let best = -1;
    for (let k = visits.firstFrom(node, time - reach); k < own.length; k += 1) {
      const i = own[k];
      if (visits.start(i) > time + reach) break;
      if (best < 0 || visits.failed(i)) best = i;
      if (visits.start(i) <= time && visits.until(i) >= time && !visits.failed(best)) best = i;
    }
    return best;
  }

  // `y` within the canvas, which stands still while the rows scroll.
  nodeAt(y) {
    return this.rows.list[Math.floor((y + this.scroller.scrollTop) / ROW)] ?? -1;
  }

  tap(x, y, event) {
    const node = this.nodeAt(y);
    const { player } = this;
    player.pause();
    player.seek(this.span.time(x));
    if (node >= 0) player.selectNode(this.visits.nodes[node].path);
    if (event.pointerType !== "mouse") this.tell(x, y, event);
  }

  tell(x, y, event) {
    const i = this.visitAt(x, y);
    this.mark(i);
    if (i < 0) this.tip.hide();
    else this.tip.show(visitCard(this.visits, i), event);
  }

  mark(i) {
    if (i === this.hover) return;
    this.hover = i;
    this.later();
  }

  bandAt(x, y) {
    const { span, section, player } = this;
    const near = (time) => Math.abs(span.x(time) - x) < 7;
    if (y > BAND.items + BAND.marks) return null;
    if (y <= BAND.items) {
      const time = span.time(x);
      return { item: section.items.find(({ first, last }) => player.times[first] <= time && time <= player.times[last]) };
    }
    const failure = player.failures.findIndex(({ time }) => near(time));
    return { failure, mark: section.marks.find(({ time }) => near(time)) };
  }

  tapBand(x, y, event) {
    const { player, span } = this;
    const found = this.bandAt(x, y);
    if (found?.failure >= 0) player.selectFailure(found.failure);
    else {
      player.pause();
      player.seek(found?.mark?.time ?? span.time(x));
      if (found?.mark?.node) player.selectNode(found.mark.node);
    }
    if (event.pointerType !== "mouse") this.tellBand(x, y, event);
  }

  tellBand(x, y, event) {
    const card = markWords(this.bandAt(x, y), this.player);
    if (card) this.tip.show(card, event);
    else this.tip.hide();
  }

  // Drawing: at most once a frame.

  follow(time) {
    if (this.player.playing) this.span.follow(time);
    this.place(time);
  }

  place(time) {
    const x = this.span.x(time);
    this.cursor.hidden = x < 0 || x > this.span.width;
    this.cursor.style.transform = `translateX(${x}px)`;
  }

  later() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  draw() {
    const { scroller, span, visits, rows, paint, section, player } = this;
    const width = this.canvas.parentElement.clientWidth;
    const height = Math.min(scroller.clientHeight, rows.list.length * ROW);
    if (!width) return;
    span.width = width;
    this.canvas.style.height = `${height}px`;
    const top = scroller.scrollTop;
    paint.lanes(this.canvas, { visits, rows, span, width, height, top, selected: this.selected, hover: this.hover });
    const { items, marks } = section;
    paint.band(this.bandCanvas, { span, width, items, marks, failures: player.failures, failure: this.failure, times: player.times });
    this.place(player.time);
  }
}

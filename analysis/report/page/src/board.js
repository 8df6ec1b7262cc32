// What the robot knew at the present tick: the blackboard, and its belief beside the truth.

import "./board.css";

import { Changes } from "./columns.js";
import { made } from "./made.js";
import { valueText } from "./words.js";

const FAR = 10; // mm off from which a belief is marked
const LOST = 30;

export class Board {
  constructor(host, section, player) {
    Object.assign(this, { player, section });
    host.classList.add("board");
    host.append(this.belief(section.belief, section.truth), this.blackboard(section.writes));
    player.onTick((tick) => this.at(tick));
  }

  // The belief.

  belief({ object, time, words }, truth) {
    this.beliefs = new Changes(object, time);
    this.truths = new Changes(truth.object, truth.tick);
    this.gone = new Map(truth.gone.map((one) => [one.object, one.tick]));
    this.truthNumbers = new Map(truth.words.map((word, number) => [word, number]));
    this.objects = [...this.beliefs.rows.keys()].sort((a, b) => words[a].localeCompare(words[b], undefined, { numeric: true }));
    const heads = [
      ["object"], ["kind", "wide"], ["at, mm"], ["turned", "wide"], ["sure", "wide"], ["seen", "seen", "Time since the object was last seen"], ["where"],
      ["off, mm", "off", "Distance of the true place from the believed place; the robot does not know it"],
    ];
    const head = made("tr", {}, ...heads.map(([text, kind, title]) => made("th", { class: kind ?? "", title }, text)));
    this.lines = new Map(this.objects.map((number) => [number, this.line(words[number])]));
    this.unknown = made("p", { class: "board-unknown", hidden: true });
    this.nothing = made("p", { class: "board-none" }, "The robot knows of nothing yet.");
    this.table = made("table", { class: "belief" }, made("thead", {}, head), made("tbody", {}, ...[...this.lines.values()].map(({ root }) => root)));
    return made("div", { class: "board-part" },
      made("h3", {}, "Belief", made("small", {}, "the second number is the error of the belief, for the analyst only")),
      this.nothing,
      made("div", { class: "board-scroll" }, this.table),
      this.unknown,
    );
  }

  line(name) {
    const cells = ["kind wide", "at", "turned wide", "sure wide", "seen", "where", "off"].map((kind) => made("td", { class: kind }));
    const swatch = made("i", { class: "swatch" });
    const root = made("tr", {}, made("th", { scope: "row" }, swatch, name), ...cells);
    const [kind, at, turned, sure, seen, where, off] = cells;
    return { root, swatch, cells: { kind, at, turned, sure, seen, where, off } };
  }

  showBelief(tick, time, before) {
    const { belief, truth } = this.section;
    for (const [number, { root, swatch, cells }] of this.lines) {
      const row = this.beliefs.at(number, time);
      const there = row >= 0 && belief.there[row] === 1;
      const changed = row >= 0 && belief.time[row] > before + 1e-6;
      root.classList.toggle("gone", !there);
      root.classList.toggle("changed", changed);
      root.hidden = row < 0;
      if (row < 0) continue;
      if (!there) {
        for (const cell of Object.values(cells)) put(cell, "");
        put(cells.where, `gone since ${belief.time[row].toFixed(1)} s`);
        continue;
      }
      const word = (column) => belief.words[belief[column][row]];
      swatch.style.background = `var(--swatch-${word("colour")}, ${word("colour") || "none"})`;
      put(cells.kind, `${word("colour")} ${word("kind")}`.trim());
      put(cells.at, ["x", "y", "z"].map((axis) => (1000 * belief[axis][row]).toFixed(0).replace("-", "−")).join(", "));
      put(cells.turned, angles(belief.yaw[row], belief.tilt[row]));
      put(cells.sure, `${Math.round(100 * belief.confidence[row])} %`);
      const ago = time - belief.last_seen[row];
      put(cells.seen, ago < 0.06 ? "now" : `${ago < 10 ? ago.toFixed(1) : ago.toFixed(0)} s`);
      put(cells.where, belief.attached[row] ? "in the hand" : word("place"));
      this.showOff(cells.off, belief.words[number], tick, truth);
    }
    this.nothing.hidden = [...this.lines.values()].some(({ root }) => !root.hidden);
    this.table.hidden = !this.nothing.hidden;
    this.showUnknown(tick, truth);
  }

  // `distance` was taken once a second; it is shown with its own time.
  showOff(cell, name, tick, truth) {
    const { times } = this.player;
    const since = this.gone.get(name);
    if (tick >= since) return put(cell, "not there", "off lost", `taken away at ${times[since].toFixed(2)} s; the robot does not know it`);
    const number = this.truthNumbers.get(name);
    const row = number === undefined ? -1 : this.truths.at(number, tick);
    if (row < 0) return put(cell, "", "off");
    const off = truth.distance[row];
    const kind = off > LOST ? "off lost" : off > FAR ? "off far" : "off";
    const title = `at ${times[truth.tick[row]].toFixed(2)} s, from ${truth.words[truth.true[row]]}`;
    return put(cell, off < 10 ? off.toFixed(1) : off.toFixed(0), kind, title);
  }

  showUnknown(tick, { unknown }) {
    const bodies = unknown.findLast((one) => one.tick <= tick)?.bodies ?? [];
    this.unknown.hidden = bodies.length === 0;
    const more = bodies.length > 5 ? ` and ${bodies.length - 5} more` : "";
    put(this.unknown, bodies.length ? `There, but not believed: ${bodies.slice(0, 5).join(", ")}${more}` : "");
  }

  // The blackboard.

  blackboard({ tick, key, words }) {
    this.writes = new Changes(key, tick);
    this.keys = [...this.writes.rows.keys()].sort((a, b) => compareKeys(words[a], words[b]));
    this.entries = new Map(this.keys.map((number) => [number, entry(words[number])]));
    const rows = this.keys.flatMap((number, k) => {
      const above = scopeOf(words[number]);
      const heading = k === 0 || above !== scopeOf(words[this.keys[k - 1]]) ? [scope(above)] : [];
      return [...heading, this.entries.get(number).root];
    });
    const none = made("p", { class: "board-none" }, "The mission writes nothing.");
    return made("div", { class: "board-part" },
      made("h3", {}, "Blackboard"),
      this.keys.length
        ? made("div", { class: "board-scroll" }, made("table", { class: "blackboard" }, made("colgroup", {}, made("col", { class: "key" }), made("col"), made("col", { class: "by" })), made("tbody", {}, ...rows)))
        : none,
    );
  }

  showBlackboard(tick) {
    const { writes } = this.section;
    for (const [number, { root, value, since }] of this.entries) {
      const row = this.writes.at(number, tick);
      root.classList.toggle("changed", row >= 0 && writes.tick[row] === tick);
      root.classList.toggle("gone", row < 0);
      put(value, row < 0 ? "not written yet" : valueText(JSON.parse(writes.words[writes.value[row]])));
      const by = row < 0 ? "" : writes.words[writes.node[row]].split("/").pop();
      put(since, row < 0 ? "" : `${this.player.times[writes.tick[row]].toFixed(2)} s ${by}`);
    }
  }

  at(tick) {
    const { times } = this.player;
    this.showBelief(tick, times[tick], tick ? times[tick - 1] : -1);
    this.showBlackboard(tick);
  }
}

// Of a sub-tree's keys all have its path before them: it stands above them once.
function scopeOf(key) {
  return key.slice(0, Math.max(key.lastIndexOf("/"), 0));
}

function compareKeys(a, b) {
  return scopeOf(a).localeCompare(scopeOf(b)) || a.localeCompare(b);
}

function scope(path) {
  const names = path.split("/");
  const above = names.slice(0, -1).join(" › ");
  const head = made("th", { class: "scope", colspan: 3, scope: "rowgroup", title: path }, made("b", {}, names.at(-1)), above ? made("span", {}, above) : null);
  return made("tr", {}, head);
}

function entry(name) {
  const value = made("td", { class: "value" });
  const since = made("td", { class: "since" });
  const root = made("tr", {}, made("th", { scope: "row", title: name }, name.split("/").at(-1)), value, since);
  return { root, value, since };
}

// Sets what differs, so that the page is not laid out anew at each tick.
function put(cell, text, kind, title) {
  if (cell.textContent !== text) cell.textContent = text;
  if (kind !== undefined && cell.className !== kind) cell.className = kind;
  if (title !== undefined && cell.title !== title) cell.title = title;
}

function angles(yaw, tilt) {
  const degrees = (angle) => `${Math.round((180 / Math.PI) * angle)}°`.replace("-", "−");
  return tilt > 0.1 ? `${degrees(yaw)}, tilted ${degrees(tilt)}` : degrees(yaw);
}

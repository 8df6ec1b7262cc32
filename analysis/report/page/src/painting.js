// Draws lanes and the band above them on canvases.

import { colour } from "./theme.js";
import { roundTimes } from "./span.js";

export const ROW = 22; // height of a lane, pixels
export const BAND = { axis: 18, items: 20, marks: 24, height: 66 };
const STEPPED = 110; // length of a bar from which on its steps are drawn, pixels
const FONT = 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, "DejaVu Sans", sans-serif';
const NAMES = [
  "paper", "sheet", "bar", "rim", "ink", "muted", "success", "success_fill", "failure", "failure_fill",
  "running", "running_fill", "skipped", "cure_rim", "output", "found",
];
const LOOKS = { SUCCESS: "success", FAILURE: "failure", RUNNING: "running", HALTED: "muted", SKIPPED: "skipped" };
export const FATES = { cured: "success", done_instead: "muted", passed_over: "cure_rim", branched: "muted", ended: "failure", open: "failure" };
// What items are said to look like, a little muted so that text on it can be read.
const HUES = { red: 4, green: 145, blue: 215, yellow: 48, orange: 28, purple: 280, pink: 330, brown: 20, cyan: 190 };

export class Paint {
  constructor() {
    this.refresh();
  }

  // The colours as the page has them now.
  refresh() {
    this.colours = Object.fromEntries(NAMES.map((name) => [name, colour(name)]));
    this.dark = document.documentElement.dataset.theme === "dark";
  }

  item(name) {
    const hue = HUES[name];
    const [saturation, light] = this.dark ? ["38%", "30%"] : ["62%", "84%"];
    return hue === undefined ? this.colours.bar : `hsl(${hue} ${saturation} ${light})`;
  }

  // The canvas in the right size for its box, cleared; null where it has none.
  begin(canvas, width, height) {
    if (width < 1 || height < 1) return null;
    const ratio = Math.min(devicePixelRatio || 1, 3);
    const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== across || canvas.height !== down) Object.assign(canvas, { width: across, height: down });
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.textBaseline = "middle";
    return context;
  }

  // Lanes.

  lanes(canvas, { visits, rows, span, width, height, top, selected, hover }) {
    const context = this.begin(canvas, width, height);
    if (!context) return;
    const { colours } = this;
    const shown = rows.list;
    const first = Math.max(Math.floor(top / ROW), 0);
    const last = Math.min(Math.ceil((top + height) / ROW), shown.length);
    context.fillStyle = colours.rim;
    context.globalAlpha = 0.45;
    for (const { time } of roundTimes(span, 90)) context.fillRect(Math.round(span.x(time)), 0, 1, height);
    context.globalAlpha = 1;
    for (let k = first; k < last; k += 1) {
      const y = k * ROW - top;
      const node = shown[k];
      if (node === selected) {
        context.fillStyle = colours.running_fill;
        context.globalAlpha = 0.6;
        context.fillRect(0, y, width, ROW);
        context.globalAlpha = 1;
      }
      this.lane(context, visits, node, span, y, hover, rows);
    }
  }

  lane(context, visits, node, span, y, hover, rows) {
    const own = visits.byNode[node];
    const leaf = visits.nodes[node].leaf;
    const look = leaf ? { top: y + 3, height: ROW - 6, leaf } : { top: y + 6, height: ROW - 12, leaf };
    for (let k = visits.firstFrom(node, span.from); k < own.length; k += 1) {
      const i = own[k];
      const x = span.x(visits.start(i));
      if (x > span.width) break;
      const right = Math.max(span.x(visits.until(i)), x + 1);
      this.bar(context, visits, i, x, right, look, i === hover);
      this.steps(context, visits, i, span, look);
      // Of several within one pixel the first is drawn; failures come on top in any case.
      if (right - x <= 1.5) {
        const next = visits.firstFrom(node, span.time(Math.floor(x) + 1));
        if (next > k + 1) k = next - 1;
      }
    }
    for (const i of visits.failing[node]) {
      const x = span.x(visits.start(i));
      const right = span.x(visits.until(i));
      if (right < 0 || x > span.width || right - x > 3) continue;
      context.fillStyle = this.colours.failure;
      context.fillRect(x - 1, look.top, 3, look.height);
    }
    if (!rows.isOpen(node)) this.hidden(context, visits, rows, node, span, y);
  }

  bar(context, visits, i, x, right, { top, height, leaf }, hovered) {
    const { colours } = this;
    const name = LOOKS[visits.outcome(i)];
    // What is cut off on the left keeps its text in sight.
    const left = Math.max(x, -2);
    const width = Math.min(right, 4000) - left;
    const gap = width > 4 ? 1 : 0;
    const solid = leaf || name === "running";
    context.fillStyle = solid || !colours[`${name}_fill`] ? colours[name] : colours[`${name}_fill`];
    if (name === "skipped" || (!leaf && name === "muted")) context.globalAlpha = 0.45;
    context.fillRect(left, top, width - gap, height);
    context.globalAlpha = 1;
    if (!leaf && width > 3) {
      context.strokeStyle = colours[name];
      context.lineWidth = 1;
      context.strokeRect(left + 0.5, top + 0.5, width - gap - 1, height - 1);
    }
    if (hovered) {
      context.strokeStyle = colours.ink;
      context.lineWidth = 2;
      context.strokeRect(left, top - 1, width - gap, height + 2);
    }
    if (leaf && width > 46 && !(visits.steps(i).length && width > STEPPED)) this.text(context, label(visits, i), left + 4, top + height / 2 + 0.5, width - 8, colours.paper);
  }

  // The steps within a bar that is long enough: where each begins, and its name.
  steps(context, visits, i, span, { top, height, leaf }) {
    const [begin, end] = [span.x(visits.start(i)), span.x(visits.until(i))];
    if (!leaf || end - begin <= STEPPED) return;
    for (const [name, from, to, outcome] of visits.steps(i)) {
      const [x, right] = [Math.max(span.x(from), -2), Math.min(span.x(to), 4000)];
      if (right < 0 || x > span.width || right - x < 3) continue;
      if (outcome === "failure") {
        context.fillStyle = this.colours.failure;
        context.fillRect(x, top, right - x, height);
      }
      context.fillStyle = this.colours.paper;
      context.fillRect(x, top, 1, height);
      if (right - x > 30) this.text(context, name, x + 4, top + height / 2 + 0.5, right - x - 6, this.colours.paper);
    }
  }

  // Failures of what is folded away below a node.
  hidden(context, visits, rows, node, span, y) {
    context.fillStyle = this.colours.failure;
    for (const i of rows.failuresUnder(node)) {
      const x = span.x(visits.end(i));
      if (x < -4 || x > span.width + 4) continue;
      triangle(context, x, y + 1, 4);
    }
  }

  // The band above: items, marks, times.

  band(canvas, { span, width, items, marks, failures, failure, times }) {
    const context = this.begin(canvas, width, BAND.height);
    if (!context) return;
    const { colours } = this;
    for (const { item, first, last, outcome, colour: name } of items) {
      const x = Math.max(span.x(times[first]), -2);
      const right = Math.min(Math.max(span.x(times[last]), x + 1), width + 2);
      if (right < 0 || x > width) continue;
      context.fillStyle = this.item(name);
      context.fillRect(x, 1, Math.max(right - x - 1, 1), BAND.items - 3);
      if (outcome === "FAILURE" || outcome === "HALTED") {
        context.fillStyle = colours[LOOKS[outcome]];
        context.fillRect(x, BAND.items - 4, Math.max(right - x - 1, 1), 2.5);
      }
      if (right - x > 30) this.text(context, item, x + 4, BAND.items / 2 - 0.5, right - x - 8, colours.ink);
    }
    for (const { time, kind } of marks) this.mark(context, kind, span.x(time), BAND.items, width);
    for (const [number, { time, fate }] of failures.entries()) {
      const x = span.x(time);
      if (x < -8 || x > width + 8) continue;
      context.fillStyle = colours[FATES[fate] ?? "failure"];
      triangle(context, x, BAND.items + 1, number === failure ? 6.5 : 5);
    }
    context.fillStyle = colours.rim;
    context.fillRect(0, BAND.height - 1, width, 1);
    for (const { time, text } of roundTimes(span, 90)) {
      const x = Math.round(span.x(time));
      context.fillStyle = colours.rim;
      context.fillRect(x, BAND.height - 6, 1, 6);
      this.text(context, `${text} s`, x + 4, BAND.height - BAND.axis / 2, 80, colours.muted);
    }
  }

  // In the lower half of the row: the upper one belongs to the failures.
  mark(context, kind, x, top, width) {
    const y = top + 17;
    if (x < -6 || x > width + 6) return;
    const { colours } = this;
    context.beginPath();
    if (kind === "item_done") {
      context.fillStyle = colours.success;
      context.arc(x, y, 3, 0, 7);
    } else if (kind === "recovery") {
      context.fillStyle = colours.cure_rim;
      context.rect(x - 1.25, y - 4, 2.5, 8);
      context.rect(x - 4, y - 1.25, 8, 2.5);
    } else {
      context.fillStyle = kind === "fault" ? colours.output : colours.ink;
      for (const [dx, dy] of [[0, -5], [5, 0], [0, 5], [-5, 0]]) context.lineTo(x + dx, y + dy);
    }
    context.fill();
  }

  text(context, text, x, y, room, style) {
    context.font = `11px ${FONT}`;
    context.fillStyle = style;
    const shown = fitted(context, text, room);
    if (shown) context.fillText(shown, x, y);
  }
}

function label(visits, i) {
  const cause = visits.word("cause", i);
  const about = visits.about(i);
  return cause ? (about ? `${cause} · ${about}` : cause) : about;
}

// As much of a text as there is room for; nothing where that would be a letter or two.
function fitted(context, text, room) {
  const width = context.measureText(text).width;
  if (width <= room) return text;
  const letters = Math.floor((text.length * room) / width) - 1;
  return letters < 4 ? "" : `${text.slice(0, letters)}…`;
}

function triangle(context, x, y, size) {
  context.beginPath();
  context.moveTo(x - size, y);
  context.lineTo(x + size, y);
  context.lineTo(x, y + 1.7 * size);
  context.fill();
}

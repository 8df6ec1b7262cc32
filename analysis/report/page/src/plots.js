// Joints, tracking, forces and the gripper over time, side by side under one cursor.

import "uplot/dist/uPlot.min.css";
import "./plots.css";

import UPlot from "uplot";

import { made } from "./made.js";
import { colour, onTheme, recall, remember } from "./theme.js";

const OPEN = new Set(["position", "velocity", "tracking", "force", "width"]);
const HEIGHT = 150;

export class Plots {
  constructor(host, section, player, tools) {
    Object.assign(this, { player, all: [], range: null });
    host.classList.add("plots");
    this.all = section.plots.map((plot) => this.frame(plot, host));
    tools.append(
      made("button", { class: "chip", title: "Show the whole run", onclick: () => this.zoom(null) }, "Whole run"),
    );
    host.append(made("p", { class: "plots-hint" }, "Click to go there, drag to zoom, double-click for the whole run; click a name to hide its curve."));
    new ResizeObserver(() => this.size()).observe(host);
    onTheme(() => this.redraw());
    player.onTime((time) => this.follow(time));
    player.onFailure(() => this.redraw());
  }

  frame(plot, host) {
    const closed = (recall(`plot.${plot.name}`) ?? (OPEN.has(plot.name) ? "open" : "closed")) === "closed";
    const box = made("div", { class: "plot-box" });
    const values = made("span", { class: "plot-values" });
    const root = made("details", { class: `plot${plot.labels.length === 1 ? " single" : ""}`, "data-plot": plot.name },
      made("summary", {}, made("b", {}, plot.title), made("span", { class: "unit" }, plot.unit), values),
      box,
      plot.note ? made("p", { class: "plot-note" }, plot.note) : null,
    );
    root.open = !closed;
    host.append(root);
    const one = { plot, root, box, values, chart: null };
    root.addEventListener("toggle", () => {
      remember(`plot.${plot.name}`, root.open ? "open" : "closed");
      this.size();
    });
    return one;
  }

  // Makes what can be seen and has not been made, and gives all the width that there is.
  size() {
    for (const one of this.all) {
      const width = one.box.clientWidth;
      if (!one.root.open || width < 60) continue;
      if (!one.chart) one.chart = this.make(one, width);
      else if (one.chart.width !== width) one.chart.setSize({ width, height: HEIGHT });
    }
    // A new chart empties its legend once more before it is drawn.
    requestAnimationFrame(() => this.follow(this.player.time));
  }

  make({ plot, box }, width) {
    const cursor = made("div", { class: "plot-cursor" });
    const chart = new UPlot(
      {
        width,
        height: HEIGHT,
        padding: [8, 14, 0, 0],
        scales: { x: { time: false, range: (_, from, to) => this.range ?? [from, to] } },
        cursor: { sync: { key: "picktree" }, y: false, drag: { x: true, y: false, setScale: false }, points: { size: 6 } },
        legend: { live: true, markers: { width: 2 } },
        axes: [
          axis({ size: 30, values: (_, ticks) => ticks.map((tick) => `${tick} s`) }),
          axis({ size: 52 }),
        ],
        series: [
          { label: "time", value: (_, time) => (time === null ? "" : `${time.toFixed(2)} s`) },
          ...plot.labels.map((label, k) => ({
            label,
            stroke: () => colour(`curve${plot.labels.length === 1 ? 0 : label === "size" ? 7 : k % 7}`),
            width: label === "size" ? 1.6 : 1.2,
            points: { show: false },
            value: (_, value) => (value === null || Number.isNaN(value) ? "–" : rounded(value)),
          })),
        ],
        hooks: {
          setSelect: [(made) => this.select(made)],
          draw: [(made) => this.marks(made)],
        },
      },
      [plot.times, ...plot.values.map(gaps)],
      box,
    );
    this.listen(chart, cursor);
    return chart;
  }

  listen(chart, cursor) {
    const { over } = chart;
    chart.playerCursor = cursor;
    over.append(cursor);
    let pressed = null;
    over.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
    over.addEventListener("click", (event) => {
      if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      this.player.pause();
      this.player.seek(chart.posToVal(event.clientX - over.getBoundingClientRect().left, "x"));
    });
    over.addEventListener("dblclick", () => this.zoom(null));
  }

  select(chart) {
    const { left, width } = chart.select;
    if (width < 5) return;
    this.zoom([chart.posToVal(left, "x"), chart.posToVal(left + width, "x")]);
    chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  // All plots show the same stretch of time; null is the whole run.
  zoom(range) {
    this.range = range;
    const { begin, end } = this.player;
    const [min, max] = range ?? [begin, end];
    for (const { chart } of this.all) chart?.setScale("x", { min, max });
    this.follow(this.player.time);
  }

  marks(chart) {
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.lineWidth = Math.max(devicePixelRatio, 1);
    ctx.strokeStyle = colour("failure");
    for (const [number, { time }] of this.player.failures.entries()) {
      const x = Math.round(chart.valToPos(time, "x", true));
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.globalAlpha = number === this.player.failure ? 1 : 0.25;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }

  follow(time) {
    for (const { chart, plot, root, values } of this.all) {
      const place = nearest(plot.times, time);
      const text = plot.labels.length > 4 ? "" : plot.labels.map((label, k) => `${plot.labels.length > 1 ? `${label} ` : ""}${said(plot.values[k][place])}`).join("   ");
      if (values.textContent !== text) values.textContent = text;
      if (!chart || !root.open) continue;
      const x = chart.valToPos(time, "x");
      chart.playerCursor.hidden = !(x >= 0 && x <= chart.over.clientWidth);
      chart.playerCursor.style.transform = `translateX(${x}px)`;
      if (chart.cursor.left === undefined || chart.cursor.left < 0) chart.setLegend({ idx: place }, false);
    }
  }

  redraw() {
    for (const { chart } of this.all) chart?.redraw(false, true);
  }
}

function axis(more) {
  return {
    stroke: () => colour("muted"),
    grid: { stroke: () => colour("rim"), width: 0.5 },
    ticks: { stroke: () => colour("rim"), width: 0.5, size: 4 },
    font: '11px system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif',
    ...more,
  };
}

// uPlot knows null as a gap, not NaN.
function gaps(values) {
  return Array.from(values, (value) => (Number.isNaN(value) ? null : value));
}

function nearest(times, time) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-4) low = middle + 1;
    else high = middle;
  }
  return Math.max(low - 1, 0);
}

function said(value) {
  return value === undefined || Number.isNaN(value) ? "–" : rounded(value);
}

function rounded(value) {
  const size = Math.abs(value);
  return value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3).replace("-", "−");
}

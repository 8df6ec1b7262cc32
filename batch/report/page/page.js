// Draws a batch: every figure is drawn again when the width changes.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const P = picktreePlot;

const percent = (value) => `${(100 * value).toFixed(1)} %`;
const interval = (rate) => `${(100 * rate.low).toFixed(1)} … ${percent(rate.high)}`;
const words = (rate) => (rate.total ? `${rate.successes} of ${rate.total}, ${interval(rate)}` : "none");

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function recipesTable() {
  const head = ["recipe", "jobs", "goal reached", "items sorted", "picks an hour", "crashed"];
  const rows = data.recipes.map((recipe) => {
    const spread = recipe.picks_an_hour;
    const cells = [
      recipe.success.total,
      `${percent(recipe.success.successes / Math.max(recipe.success.total, 1))} (${interval(recipe.success)})`,
      recipe.items.total ? `${recipe.items.successes} of ${recipe.items.total} (${interval(recipe.items)})` : "none",
      spread ? `${spread.median.toFixed(0)} (${spread.low.toFixed(0)} … ${spread.high.toFixed(0)})` : "none",
      recipe.crashed,
    ];
    return element("tr", {}, element("td", {}, recipe.label),
      ...cells.map((text) => element("td", { class: "number" }, String(text))));
  });
  const header = head.map((text, n) => element("th", n ? { class: "number" } : {}, text));
  return element("div", { class: "scroll" },
    element("table", {}, element("thead", {}, element("tr", {}, ...header)), element("tbody", {}, ...rows)));
}

// A share with its interval for each of several names.
function shares(rows, width) {
  const longest = Math.max(...rows.map((row) => row.label.length));
  return P.plot({
    width,
    height: 46 + 30 * rows.length,
    marginLeft: Math.min(width * 0.42, 18 + 6.6 * longest),
    marginRight: 16,
    x: { domain: [0, 100], label: "%", grid: true },
    y: { domain: rows.map((row) => row.label), label: null, tickFormat: (text) => shortened(text, width) },
    marks: [
      P.ruleY(rows, {
        y: "label", x1: (row) => 100 * row.rate.low, x2: (row) => 100 * row.rate.high,
        stroke: "var(--mark)", strokeWidth: 3, strokeOpacity: 0.45,
      }),
      P.dot(rows, {
        y: "label", x: (row) => (100 * row.rate.successes) / row.rate.total, fill: "var(--mark)", r: 5,
      }),
      P.tip(rows, P.pointer({
        y: "label", x: (row) => (100 * row.rate.successes) / row.rate.total,
        title: (row) => `${row.label}\n${words(row.rate)}`, fill: "var(--card)",
      })),
    ],
  });
}

function rates(width) {
  const labels = data.recipes.map((recipe) => recipe.label);
  return P.plot({
    width,
    height: Math.max(150, 92 * labels.length + 50),
    marginLeft: 44,
    x: { label: "picks in a simulated hour →", grid: true, nice: true },
    y: { label: "jobs", grid: true },
    fy: { label: null, domain: labels, axis: null },
    marks: [
      P.rectY(data.rates, P.binX({ y: "count" }, { x: "rate", fy: "label", fill: "var(--mark)", thresholds: 24, tip: true })),
      P.text(labels.length > 1 ? labels.map((label) => ({ label })) : [], {
        fy: "label", text: (row) => shortened(row.label, width), frameAnchor: "top-left", dx: 4, fill: "var(--faint)",
      }),
      P.ruleY([0]),
    ],
  });
}

const PHASES = ["observe", "think", "move", "grasp", "place", "recover", "other"];
const PHASE_COLOURS = ["#5b8def", "#9a6fe0", "#8a97a8", "#2fa36b", "#17a2b8", "#d9763a", "#b6bec9"];

function phases(width) {
  const rows = data.recipes.flatMap((recipe) =>
    PHASES.filter((phase) => recipe.seconds_a_pick[phase]).map((phase) => ({
      label: recipe.label, phase, seconds: recipe.seconds_a_pick[phase],
    })));
  const longest = Math.max(...data.recipes.map((recipe) => recipe.label.length));
  return P.plot({
    width,
    height: 80 + 34 * data.recipes.length,
    marginLeft: Math.min(width * 0.42, 18 + 6.6 * longest),
    marginRight: 16,
    x: { label: "s →", grid: true },
    y: { label: null, domain: data.recipes.map((recipe) => recipe.label), tickFormat: (text) => shortened(text, width) },
    color: { domain: PHASES, range: PHASE_COLOURS, legend: true },
    marks: [
      P.barX(rows, P.stackX({ order: PHASES }, { x: "seconds", y: "label", fill: "phase", tip: true })),
      P.ruleX([0]),
    ],
  });
}

function causes(width) {
  let sum = 0;
  const total = data.causes.reduce((all, row) => all + row.failures, 0);
  const rows = data.causes.map((row) => ({ ...row, sum: (sum += row.failures) }));
  const bars = rows.flatMap((row) => [
    { cause: row.cause, what: "cured", count: row.cured },
    { cause: row.cause, what: "not cured", count: row.failures - row.cured },
  ]);
  const longest = Math.max(...rows.map((row) => row.cause.length));
  return P.plot({
    width,
    height: 86 + 30 * rows.length,
    marginLeft: Math.min(width * 0.5, 18 + 6.8 * longest),
    marginRight: 44,
    x: { label: "failures →", grid: true, domain: [0, total], nice: false },
    y: { label: null, domain: rows.map((row) => row.cause) },
    color: { domain: ["cured", "not cured"], range: ["var(--good)", "var(--bad)"], legend: true },
    marks: [
      P.barX(bars, { x: "count", y: "cause", fill: "what", tip: true, order: ["cured", "not cured"] }),
      P.lineY(rows, { x: "sum", y: "cause", stroke: "var(--faint)", strokeOpacity: 0.6 }),
      P.dot(rows, { x: "sum", y: "cause", r: 3, fill: "var(--faint)" }),
      P.text(rows, { x: "sum", y: "cause", text: (row) => `${Math.round((100 * row.sum) / total)} %`, dx: 8, textAnchor: "start", fill: "var(--faint)" }),
      P.ruleX([0]),
    ],
  });
}

const CELL = 0.05; // m

function places(width) {
  const cells = new Map();
  for (const item of data.items) {
    const [x, y] = [Math.floor(item.x / CELL + 1e-9), Math.floor(item.y / CELL + 1e-9)];
    const cell = cells.get(`${x} ${y}`) ?? { x: x * CELL, y: y * CELL, sorted: 0, total: 0 };
    cell.total += 1;
    cell.sorted += item.sorted;
    cells.set(`${x} ${y}`, cell);
  }
  const rows = [...cells.values()];
  const [low, high] = [Math.min(...rows.map((r) => r.y)), Math.max(...rows.map((r) => r.y)) + CELL];
  const [near, far] = [Math.min(...rows.map((r) => r.x)), Math.max(...rows.map((r) => r.x)) + CELL];
  const inner = width - 70;
  return P.plot({
    width,
    height: Math.min(520, (inner * (far - near)) / (high - low) + 70),
    marginLeft: 50,
    // As the robot sees it: x away from it upwards, y to its left.
    x: { label: "y, m", domain: [high, low], ticks: 5 },
    y: { label: "x, m", domain: [near, far], ticks: 5 },
    color: { label: "sorted, %", domain: [0, 50, 100], range: ["#c8443a", "#d9a441", "#2f8f5b"], type: "linear", legend: true, interpolate: "rgb" },
    marks: [
      P.rect(rows, {
        x1: (r) => r.y, x2: (r) => r.y + CELL, y1: (r) => r.x, y2: (r) => r.x + CELL,
        fill: (r) => (100 * r.sorted) / r.total, inset: 1,
        fillOpacity: (r) => 0.35 + 0.65 * Math.min(1, r.total / 10),
      }),
      P.tip(rows, P.pointer({
        x: (r) => r.y + CELL / 2, y: (r) => r.x + CELL / 2,
        title: (r) => `${r.sorted} of ${r.total} sorted`, fill: "var(--card)",
      })),
    ],
  });
}

function worst() {
  if (!data.worst.length) return element("p", { class: "empty" }, "Every job that was run reached its goal.");
  return element("ol", { class: "worst" }, ...data.worst.map((job) => {
    const line = element("li", {}, element("span", { class: "status" }, job.status), ` seed ${job.seed}, ${job.label}`);
    if (job.missed) line.append(`, ${job.missed} ${job.missed > 1 ? "items" : "item"} not sorted`);
    if (job.look_at) line.append(element("div", {}, job.look_at));
    if (job.report) line.append(element("div", {}, element("a", { href: job.report }, "report of the run")));
    if (job.command) line.append(element("div", {}, element("code", {}, job.command)));
    return line;
  }));
}

function shortened(text, width) {
  const most = Math.max(10, Math.floor((width * 0.42 - 18) / 6.6));
  return text.length > most ? `…${text.slice(text.length - most + 1)}` : text; // recipes differ at their ends
}

const byRate = (rows) => rows.filter((row) => row.rate.total);
const FIGURES = {
  success: (width) => shares(byRate(data.recipes.map((r) => ({ label: r.label, rate: r.success }))), width),
  rates: data.rates.length ? rates : null,
  phases: data.recipes.some((r) => Object.keys(r.seconds_a_pick).length) ? phases : null,
  causes: data.causes.length ? causes : null,
  forms: data.forms.length ? (width) => shares(byRate(data.forms), width) : null,
  colours: data.colours.length ? (width) => shares(byRate(data.colours), width) : null,
  places: data.items.length ? places : null,
};
const NOTHING = { causes: "Nothing failed." };

function draw() {
  for (const [id, figure] of Object.entries(FIGURES)) {
    const host = document.getElementById(id);
    const made = figure ? figure(host.clientWidth) : element("p", { class: "empty" }, NOTHING[id] ?? "Nothing to show.");
    host.replaceChildren(made);
  }
}

document.getElementById("subtitle").textContent = data.subtitle;
document.getElementById("footer").textContent = data.footer;
document.getElementById("recipes").append(recipesTable());
document.getElementById("worst").append(worst());
draw();
let width = window.innerWidth;
window.addEventListener("resize", () => {
  if (window.innerWidth !== width) {
    width = window.innerWidth;
    draw();
  }
});

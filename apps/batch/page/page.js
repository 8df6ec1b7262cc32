// Draws a batch: every figure is drawn again when the width changes.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const P = picktreePlot;

// As the texts round: a number halfway between two goes to the even one.
const fixed = (value, digits) => {
  if (Math.abs(value * 2 ** (digits + 1)) % 2 !== 1) return value.toFixed(digits);
  const below = Math.floor(value * 10 ** digits);
  return ((below % 2 === 0 ? below : below + 1) / 10 ** digits).toFixed(digits);
};
const percent = (value) => `${fixed(100 * value, 1)} %`;
const interval = (rate) => `${fixed(100 * rate.low, 1)} … ${percent(rate.high)}`;
const words = (rate) => (rate.total ? `${rate.successes} of ${rate.total}, ${interval(rate)}` : "none");

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Of the jobs of all recipes, or of one: what the figures below the choice show.
let chosen = data;

const share = (rate) => (rate.total ? `${percent(rate.successes / rate.total)} (${interval(rate)})` : "none");

// A mean time between events, as the texts have it.
function between(found) {
  if (found.value !== null) return `${duration(found.value)} (${duration(found.low)} … ${duration(found.high)})`;
  return found.low ? `at least ${duration(found.low)}` : "none";
}

function duration(seconds) {
  if (seconds < 120) return `${fixed(seconds, 1)} s`;
  return seconds < 7200 ? `${fixed(seconds / 60, 1)} min` : `${fixed(seconds / 3600, 1)} h`;
}

function recipesTable() {
  const head = ["recipe", "jobs", "goal reached", "items sorted", "first grasp held", "units an hour", "MTBF", "first pass", "crashed"];
  const rows = data.recipes.map((recipe) => {
    const { units_an_hour: hourly, mtbf, first_pass_yield: first } = recipe.figures;
    const cells = [
      recipe.success.total,
      share(recipe.success),
      share(recipe.items),
      share(recipe.first_try),
      hourly.value === null ? "none" : `${fixed(hourly.value, 0)} (${fixed(hourly.low, 0)} … ${fixed(hourly.high, 0)})`,
      between(mtbf),
      share(first),
      recipe.crashed,
    ];
    return element("tr", {}, element("td", {}, recipe.label),
      ...cells.map((text, n) => element("td", { class: "number", "data-head": head[n + 1] }, String(text))));
  });
  const header = head.map((text, n) => element("th", n ? { class: "number" } : {}, text));
  return element("table", {}, element("thead", {}, element("tr", {}, ...header)), element("tbody", {}, ...rows));
}

// A tile for each job, in rows by recipe; one that is chosen is told of below.
function jobs() {
  const said = element("p", { class: "note", role: "status" });
  const tell = (job) => {
    const words = [`seed ${job.seed}, ${job.label}: ${job.status}`];
    if (job.items !== null) words.push(`${job.sorted} of ${job.items} items sorted`);
    if (job.seconds !== null) words.push(`${fixed(job.seconds, 0)} simulated s`);
    return words.join(", ") + (job.look_at ? `; ${job.look_at}` : "");
  };
  const choose = (job) => {
    said.replaceChildren(tell(job), ...(job.report ? [" ", element("a", { href: job.report }, "report")] : []));
  };
  const hosts = [...new Set(data.jobs.map((job) => job.label))].map((label) => {
    const tiles = data.jobs.filter((job) => job.label === label).map((job) => {
      const tile = element("button", { type: "button", class: `tile ${job.status}`, title: tell(job), "aria-label": tell(job) });
      tile.addEventListener("click", () => choose(job));
      return tile;
    });
    return element("div", {}, element("div", { class: "note" }, label), element("div", { class: "tiles" }, ...tiles));
  });
  const counts = new Map([["success", 0]]);
  for (const job of data.jobs) counts.set(job.status, (counts.get(job.status) ?? 0) + 1);
  const legend = [...counts].map(([status, count]) =>
    element("span", {}, element("i", { class: `tile ${status}` }), ` ${count} ${status}`));
  const more = data.total > data.jobs.length ? `the first ${data.jobs.length} of ${data.total}` : "";
  return element("div", {}, element("p", { class: "legend" }, ...legend, more), ...hosts, said);
}

function choice() {
  const host = document.getElementById("choice");
  const options = [["all recipes", data], ...Object.entries(data.by_recipe)];
  if (options.length < 3) return;
  host.hidden = false;
  options.forEach(([label, what], n) => {
    const radio = element("input", { type: "radio", name: "recipe" });
    radio.checked = n === 0;
    radio.addEventListener("change", () => {
      chosen = what;
      draw();
    });
    host.append(element("label", {}, radio, label));
  });
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
    x: { label: "units in a simulated hour →", grid: true, nice: true },
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
  const total = chosen.causes.reduce((all, row) => all + row.failures, 0);
  const rows = chosen.causes.map((row) => ({ ...row, sum: (sum += row.failures) }));
  const bars = rows.flatMap((row) => [
    { cause: row.cause, what: "cured", count: row.cured },
    { cause: row.cause, what: "done instead", count: row.done_instead },
    { cause: row.cause, what: "not cured", count: row.failures - row.cured - row.done_instead },
  ]);
  const ends = ["cured", ...(rows.some((row) => row.done_instead) ? ["done instead"] : []), "not cured"];
  const colours = { cured: "var(--good)", "done instead": "var(--mark)", "not cured": "var(--bad)" };
  const longest = Math.max(...rows.map((row) => row.cause.length));
  return P.plot({
    width,
    height: 86 + 30 * rows.length,
    marginLeft: Math.min(width * 0.5, 18 + 6.8 * longest),
    marginRight: 44,
    x: { label: "failures →", grid: true, domain: [0, total], nice: false },
    y: { label: null, domain: rows.map((row) => row.cause) },
    color: { domain: ends, range: ends.map((end) => colours[end]), legend: true },
    marks: [
      P.barX(bars, { x: "count", y: "cause", fill: "what", tip: true, order: ends }),
      P.lineY(rows, { x: "sum", y: "cause", stroke: "var(--faint)", strokeOpacity: 0.6 }),
      P.dot(rows, { x: "sum", y: "cause", r: 3, fill: "var(--faint)" }),
      P.text(rows, { x: "sum", y: "cause", text: (row) => `${fixed((100 * row.sum) / total, 0)} %`, dx: 8, textAnchor: "start", fill: "var(--faint)" }),
      P.ruleX([0]),
    ],
  });
}

function places(width) {
  const cell = data.cell;
  const rows = chosen.places.map((row) => ({ ...row, ...row.rate }));
  // One frame for all recipes, so that they can be compared.
  const [low, high] = [Math.min(...data.places.map((r) => r.y)), Math.max(...data.places.map((r) => r.y)) + cell];
  const [near, far] = [Math.min(...data.places.map((r) => r.x)), Math.max(...data.places.map((r) => r.x)) + cell];
  const inner = width - 66;
  const unit = Math.min(inner / (high - low), 430 / (far - near));
  return P.plot({
    width: unit * (high - low) + 66,
    height: unit * (far - near) + 50,
    marginLeft: 50,
    marginRight: 16,
    // As the robot sees it: x away from it upwards, y to its left.
    x: { label: "y, m", domain: [high, low], ticks: 5 },
    y: { label: "x, m", domain: [near, far], ticks: 5 },
    color: { label: "sorted, %", domain: [0, 50, 100], range: ["#c8443a", "#d9a441", "#2f8f5b"], type: "linear", legend: true, interpolate: "rgb" },
    marks: [
      P.rect(rows, {
        x1: (r) => r.y, x2: (r) => r.y + cell, y1: (r) => r.x, y2: (r) => r.x + cell,
        fill: (r) => (100 * r.successes) / r.total, inset: 1,
        fillOpacity: (r) => 0.35 + 0.65 * Math.min(1, r.total / 10),
      }),
      P.text(rows.filter((r) => r.successes < r.total), {
        x: (r) => r.y + cell / 2, y: (r) => r.x + cell / 2, text: (r) => r.total - r.successes, fill: "var(--ink)",
      }),
      P.tip(rows, P.pointer({
        x: (r) => r.y + cell / 2, y: (r) => r.x + cell / 2,
        title: (r) => `${r.successes} of ${r.total} sorted\nx ${r.x.toFixed(2)} … ${(r.x + cell).toFixed(2)} m\ny ${r.y.toFixed(2)} … ${(r.y + cell).toFixed(2)} m`,
        fill: "var(--card)",
      })),
    ],
  });
}

// What the failures come from, each with the job that shows it.
function roots() {
  const head = ["first root cause", "jobs", "goal missed", "such as"];
  const rows = chosen.roots.map((row) => {
    const such = element("td", { class: "by", "data-head": head[3] }, element("div", {}, `seed ${row.seed}, ${row.label}`));
    if (row.look_at) such.append(element("div", {}, row.look_at));
    return element("tr", {}, element("td", {}, row.cause),
      element("td", { class: "number", "data-head": head[1] }, String(row.jobs)),
      element("td", { class: "number", "data-head": head[2] }, String(row.missed)), such);
  });
  const header = head.map((text, n) => element("th", n === 1 || n === 2 ? { class: "number" } : {}, text));
  return element("table", {}, element("thead", {}, element("tr", {}, ...header)), element("tbody", {}, ...rows));
}

// What was seen, tried and cured; below it what failed first after planted faults.
function cures() {
  const head = ["cause", "episodes", "cured", "tries", "s lost", "by, cured of those tried"];
  const rows = chosen.cures.map((row) => {
    const times = (count) => (count === 1 ? "once" : `${count} times`);
    const by = row.by.flatMap((each) => {
      const tried = each.seen - each.done_instead;
      const instead = each.done_instead ? [`${each.cure} instead, ${times(each.done_instead)}`] : [];
      if (each.cure) return tried ? [`${each.cure} ${each.cured} of ${tried}`, ...instead] : instead;
      const alone = each.unhandled ? [`nobody, ${times(each.unhandled)}`] : [];
      return each.given_up ? [...alone, `given up untried, ${times(each.given_up)}`] : alone;
    });
    const numbers = [
      row.seen, share(row.rate), row.tries_a_cure === null ? "–" : fixed(row.tries_a_cure, 1), fixed(row.seconds, 1),
    ];
    return element("tr", {}, element("td", {}, row.cause),
      ...numbers.map((text, n) => element("td", { class: "number", "data-head": head[n + 1] }, String(text))),
      element("td", { class: "by", "data-head": head[5] }, ...by.map((text) => element("div", {}, text))));
  });
  const header = head.map((text, n) => element("th", n && n < 5 ? { class: "number" } : {}, text));
  const table = element("table", {}, element("thead", {}, element("tr", {}, ...header)), element("tbody", {}, ...rows));
  return element("div", {}, ...(rows.length ? [table] : []), ...planted());
}

function planted() {
  const kinds = [...new Set(chosen.planted.map((row) => row.fault))];
  if (!kinds.length) return [];
  const said = { cured: "cured", done_instead: "done instead", given_up: "given up", unhandled: "not handled", open: "open at the end" };
  const rows = kinds.map((kind) => {
    const same = chosen.planted.filter((row) => row.fault === kind);
    const seen = same.map((row) => `${row.count} ${row.cause ? `${row.cause}, ${said[row.end]}` : "nothing failed"}`);
    return element("tr", {}, element("td", {}, kind),
      element("td", { class: "number", "data-head": "planted" }, String(same.reduce((all, row) => all + row.count, 0))),
      element("td", { class: "by", "data-head": "what failed first after it" }, ...seen.map((text) => element("div", {}, text))));
  });
  const header = ["planted fault", "times", "what failed first after it"].map((text, n) =>
    element("th", n === 1 ? { class: "number" } : {}, text));
  return [element("table", { class: "planted" }, element("thead", {}, element("tr", {}, ...header)), element("tbody", {}, ...rows))];
}

function worst() {
  if (!data.worst.length) return element("p", { class: "empty" }, "Every job that was run reached its goal.");
  return element("ol", { class: "worst" }, ...data.worst.map((job) => {
    const line = element("li", {}, element("span", { class: "status" }, job.status), ` seed ${job.seed}, ${job.label}`);
    if (job.missed) line.append(`, ${job.missed} ${job.missed > 1 ? "items" : "item"} not sorted`);
    if (job.root_cause) line.append(" ", element("code", {}, job.root_cause));
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

// Values of factors by their effect on failures, and the runs to compare for the first.
function drivers() {
  const head = ["value", "failed with it", "with others", "difference", "p, Holm"];
  const signed = (value) => `${value < 0 ? "" : "+"}${fixed(100 * value, 1)}`;
  const rows = data.drivers.slice(0, 12).map((row) => {
    const cells = [
      `${row.failed.successes} of ${row.failed.total}`,
      `${row.others.successes} of ${row.others.total}`,
      `${signed(row.difference)} % (${signed(row.interval.low)} … ${signed(row.interval.high)})`,
      row.adjusted < 0.001 ? "< 0.001" : fixed(row.adjusted, 3),
    ];
    const name = row.significant ? element("b", {}, row.name) : row.name;
    return element("tr", {}, element("td", {}, name),
      ...cells.map((text, n) => element("td", { class: "number", "data-head": head[n + 1] }, text)));
  });
  const header = head.map((text, n) => element("th", n ? { class: "number" } : {}, text));
  const table = element("table", {}, element("thead", {}, element("tr", {}, ...header)), element("tbody", {}, ...rows));
  const { pair } = data;
  const few = data.too_few_seeds ? [element("p", { class: "note" }, `${data.too_few_seeds}.`)] : [];
  if (!pair) return element("div", {}, table, ...few);
  const seed = pair.same_seed ? `both with seed ${pair.seed}` : "of different seeds";
  return element("div", {}, table, ...few,
    element("p", {}, `Nearest failure and success for ${pair.driver}, ${seed}:`),
    ...[...pair.remake, pair.diff, pair.whatif].map((command) => element("div", {}, element("code", {}, command))));
}

const byRate = (rows) => rows.filter((row) => row.rate.total);
// What a figure draws from, and how; nothing to draw from, nothing to draw.
const FIGURES = {
  success: [() => byRate(data.recipes.map((r) => ({ label: r.label, rate: r.success }))), shares],
  rates: [() => data.rates, (rows, width) => rates(width)],
  phases: [() => data.recipes.filter((r) => Object.keys(r.seconds_a_pick).length), (rows, width) => phases(width)],
  drivers: [() => data.drivers, () => drivers()],
  roots: [() => chosen.roots, () => roots()],
  cures: [() => [...chosen.cures, ...chosen.planted], () => cures()],
  causes: [() => chosen.causes, (rows, width) => causes(width)],
  forms: [() => byRate(chosen.forms), shares],
  colours: [() => byRate(chosen.colours), shares],
  places: [() => chosen.places, (rows, width) => places(width)],
};
const NOTHING = { drivers: "Nothing failed, or no factor has two values.", roots: "No root cause was found.", causes: "Nothing failed.", cures: "Nothing failed." };

function draw() {
  for (const [id, [rowsOf, figure]] of Object.entries(FIGURES)) {
    const host = document.getElementById(id);
    const rows = rowsOf();
    const made = rows.length
      ? figure(rows, host.clientWidth)
      : element("p", { class: "empty" }, NOTHING[id] ?? "Nothing to show.");
    host.replaceChildren(made);
  }
}

document.getElementById("subtitle").textContent = data.subtitle;
document.getElementById("footer").textContent = data.footer;
document.getElementById("recipes").append(recipesTable());
document.getElementById("jobs").append(jobs());
document.getElementById("worst").append(worst());
choice();
draw();
let width = window.innerWidth;
window.addEventListener("resize", () => {
  if (window.innerWidth !== width) {
    width = window.innerWidth;
    draw();
  }
});
document.documentElement.dataset.ready = "yes";

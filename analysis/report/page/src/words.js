// Things of a run in words: visits, marks, values.

import { made } from "./made.js";

export const FATE_WORDS = {
  cured: "cured",
  done_instead: "done instead",
  passed_over: "passed over",
  branched: "went another way",
  ended: "ended the run",
  open: "open at the end",
};

// A node by its ID, and by its name where that says more. Branches are called as the mission labels them.
export function called({ id, name, leaf }) {
  if (name === id || name.startsWith(`${id}#`)) return [name];
  return leaf ? [id, made("small", {}, ` ${name}`)] : [name];
}

// Long paths of nodes by their ends.
export function shortened(text) {
  return text.replace(/[^\s:,;()]+(?:\/[^\s:,;()]+){3,}/g, (path) => path.split("/").slice(-2).join("/"));
}

// Digits as the texts of picktree round them: a number halfway between two goes to the even one.
export function fixed(value, digits) {
  const scaled = value * 10 ** digits;
  const halfway = Math.abs(value * 2 ** (digits + 1)) % 2 === 1;
  if (!halfway) return value.toFixed(digits);
  const below = Math.floor(scaled);
  return ((below % 2 === 0 ? below : below + 1) / 10 ** digits).toFixed(digits);
}

export function seconds(time) {
  return `${fixed(time, 2)} s`;
}

// A value as it stands in the log: numbers as short as they can be read.
export function valueText(value) {
  if (typeof value === "number") {
    if (Number.isInteger(value)) return String(value);
    const size = Math.abs(value);
    return size !== 0 && (size < 1e-3 || size >= 1e6) ? value.toExponential(2) : String(Number(value.toPrecision(4)));
  }
  if (Array.isArray(value)) return value.length ? value.map(valueText).join(", ") : "[]";
  if (value && typeof value === "object") {
    return Object.entries(value).map(([key, below]) => `${key}: ${valueText(below)}`).join(", ");
  }
  return value === null ? "null" : String(value);
}

// Names with their values, as rows of a list.
export function pairs(values) {
  return made("dl", { class: "pairs" }, ...Object.entries(values).flatMap(([key, value]) => [
    made("dt", {}, key),
    made("dd", {}, valueText(value)),
  ]));
}

// Steps of a skill with what each took.
export function stepList(steps) {
  return made("dl", { class: "pairs" }, ...steps.flatMap(([name, start, end, outcome]) => [
    made("dt", {}, name),
    made("dd", {}, `${seconds(end - start)}${outcome === "success" ? "" : `, ${outcome}`}`),
  ]));
}

export function visitCard(visits, i) {
  const node = visits.nodes[visits.columns.node[i]];
  const start = visits.start(i);
  const end = visits.end(i);
  const outcome = visits.outcome(i);
  const cause = visits.word("cause", i);
  const origin = visits.word("origin", i);
  const message = visits.word("message", i);
  const about = visits.about(i);
  return [
    made("p", { class: "tip-head" }, made("b", {}, node.id), about ? ` ${about}` : ""),
    made("p", { class: `tip-outcome ${outcome.toLowerCase()}` }, cause ? `${outcome}: ${cause}` : outcome),
    made("p", { class: "tip-time" }, `${seconds(start)} – ${seconds(end)}, ${(end - start).toFixed(2)} s long`),
    ...(message ? [made("p", {}, message)] : []),
    ...(visits.steps(i).length ? [stepList(visits.steps(i))] : []),
    ...(origin && origin !== node.path ? [made("p", { class: "tip-time" }, `from ${origin.split("/").slice(-2).join("/")}`)] : []),
    ...(visits.columns.inputs[i] ? [pairs(JSON.parse(visits.word("inputs", i)))] : []),
  ];
}

// What stands at a place of the band above the lanes; null for nothing.
export function markWords(found, player) {
  if (!found) return null;
  const { item, failure, mark } = found;
  if (item) {
    const [start, end] = [player.times[item.first], player.times[item.last]];
    return [
      made("p", { class: "tip-head" }, made("b", {}, item.item)),
      made("p", { class: `tip-outcome ${item.outcome.toLowerCase()}` }, item.outcome),
      made("p", { class: "tip-time" }, `${seconds(start)} – ${seconds(end)}, ${(end - start).toFixed(2)} s long`),
    ];
  }
  if (failure >= 0) {
    const { time, cause, fate, item: about } = player.failures[failure];
    return [
      made("p", { class: "tip-head" }, made("b", {}, cause || "failure"), about ? ` ${about}` : ""),
      made("p", { class: "tip-time" }, `${seconds(time)}, ${FATE_WORDS[fate] ?? fate}`),
    ];
  }
  if (!mark) return null;
  return [
    made("p", { class: "tip-head" }, made("b", {}, mark.kind.replace("_", " "))),
    made("p", {}, mark.message),
    made("p", { class: "tip-time" }, seconds(mark.time)),
  ];
}

// Which causes were seen, and what came of them; beside it faults that were planted, and what failed first after.

import { made } from "./made.js";
import { fixed, seconds } from "./words.js";

const END_WORDS = { cured: "cured", done_instead: "done instead", given_up: "given up", unhandled: "not handled", open: "open at the end" };

// Nodes for the top of the failures; none where nothing was seen.
export function recovery({ causes, recovery: { planted } }, player) {
  const found = [];
  if (causes.length) found.push(made("h3", {}, "Seen, tried, cured"), made("ul", { class: "causes" }, ...causes.map(cause)));
  if (planted.length) {
    found.push(
      made("h3", {}, "Planted faults, and the first failure after each"),
      made("ul", { class: "moments" }, ...planted.map((fault) => plantedFault(fault, player))),
    );
  }
  return found;
}

// What was tried against the cause of a failure, in the end; empty where nothing was.
export function endOf(episode) {
  if (!episode || !episode.tried.length) return "";
  const tries = `${episode.tries} ${episode.tries === 1 ? "try" : "tries"}`;
  return `${END_WORDS[episode.end]}, last by ${episode.tried.at(-1)}, after ${tries}; ${fixed(episode.seconds, 1)} s lost`;
}

function cause({ cause: name, to_cure, cured, done_instead, told }) {
  const fate = !to_cure ? "done_instead" : cured === to_cure ? "cured" : cured ? "passed_over" : "open";
  const counts = [to_cure && `${cured} of ${to_cure} cured`, done_instead && `${done_instead} done instead`];
  return made("li", {},
    made("p", {}, made("code", {}, name), made("span", { class: `fate ${fate}` }, counts.filter(Boolean).join(", "))),
    made("p", { class: "reason" }, told),
  );
}

function plantedFault({ time, message, cause: name, after, end }, player) {
  const go = () => {
    player.pause();
    player.seek(time);
  };
  const then = end === null ? "nothing failed" : `${name} ${fixed(after, 1)} s later, ${END_WORDS[end]}`;
  return made("li", {}, made("button", { class: "moment", onclick: go }, made("time", {}, seconds(time)), made("span", {}, `${message}: ${then}`)));
}

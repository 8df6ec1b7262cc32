// The chosen node at the present time: what it did, with what, and how it ended.

import { made } from "./made.js";
import { called, pairs, seconds, stepList } from "./words.js";

export class Details {
  // `onvisit(i)`: another visit of the node is to be shown.
  constructor(host, visits, player, onvisit) {
    Object.assign(this, { host, visits, player, onvisit, node: -1, shown: null });
    this.head = made("div", { class: "details-head" });
    this.body = made("div", { class: "details-body" });
    host.append(this.head, this.body);
  }

  choose(node) {
    this.node = node;
    this.shown = null;
    this.show(this.player.tick);
  }

  show(tick) {
    const { visits, node } = this;
    if (node < 0) {
      this.host.dataset.status = "";
      if (this.shown !== "") this.body.replaceChildren();
      this.head.replaceChildren(made("span", { class: "details-none" }, "Choose a node or a bar to see what it did."));
      this.shown = "";
      return;
    }
    const i = visits.at(node, tick);
    const status = visits.status(node, tick);
    const key = `${node} ${i} ${status}`;
    if (this.shown === key) return;
    this.shown = key;
    this.host.dataset.status = status.toLowerCase();
    const own = visits.byNode[node];
    const place = own.indexOf(i);
    this.head.replaceChildren(...this.title(node, own, place));
    this.body.replaceChildren(...(i < 0 ? [this.never(own)] : this.visit(i, status)));
  }

  title(node, own, place) {
    const { path } = this.visits.nodes[node];
    const step = (text, title, to) =>
      made("button", { class: "icon", title, "aria-label": title, disabled: own[to] === undefined, onclick: () => this.onvisit(own[to]) }, text);
    const steps = path.split("/").slice(0, -1).join(" › ");
    return [
      made("b", {}, ...called(this.visits.nodes[node])),
      made("span", { class: "details-path", title: path }, steps),
      own.length
        ? made("span", { class: "details-steps" },
            step("‹", "Its visit before", place - 1),
            made("span", {}, place < 0 ? `${own.length} to come` : `visit ${place + 1} of ${own.length}`),
            step("›", "Its next visit", place + 1))
        : "",
    ];
  }

  never(own) {
    if (!own.length) return made("p", {}, "The run never reached this node.");
    return made("p", {}, `The run has not reached this node yet; it will at ${seconds(this.visits.start(own[0]))}.`);
  }

  visit(i, status) {
    const { visits } = this;
    const running = status === "RUNNING";
    const [start, end] = [visits.start(i), visits.end(i)];
    const outcome = visits.outcome(i);
    const cause = visits.word("cause", i);
    const ended = outcome === "RUNNING" ? "not ended when the log ends" : `${outcome}${cause ? `: ${cause}` : ""} at ${seconds(end)}`;
    const origin = visits.word("origin", i);
    const path = visits.nodes[visits.columns.node[i]].path;
    const facts = {
      "": running ? "running now" : status ? "ends in this tick" : "the node's last visit, which has ended",
      began: seconds(start),
      ended: `${ended}, after ${(end - start).toFixed(2)} s`,
    };
    const about = visits.about(i);
    if (about) facts.about = about;
    const rows = Object.entries(facts).flatMap(([key, value]) => [made("dt", {}, key || "now"), made("dd", {}, value)]);
    const message = visits.word("message", i);
    const told = [
      made("dl", { class: "pairs" }, ...rows),
      message ? made("p", { class: `details-message ${outcome.toLowerCase()}` }, message) : "",
      origin && origin !== path
        ? made("p", {}, "from ", made("button", { class: "link", onclick: () => this.player.selectNode(origin) }, origin.split("/").slice(-2).join(" › ")))
        : "",
    ];
    const steps = visits.steps(i);
    const listed = steps.length ? [made("div", { class: "details-values" }, made("h3", {}, "steps"), stepList(steps))] : [];
    return [made("div", {}, ...told), ...listed, ...this.values("inputs", i), ...this.values("evidence", i)];
  }

  values(column, i) {
    if (!this.visits.columns[column][i]) return [];
    return [made("div", { class: "details-values" }, made("h3", {}, column), pairs(JSON.parse(this.visits.word(column, i))))];
  }
}

// Why the run went as it did: root causes, then every failure with what became of it.

import "./failures.css";

import { made } from "./made.js";
import { endOf, recovery } from "./recovery.js";
import { bring, onShown } from "./scrolling.js";
import { FATE_WORDS, pairs, seconds, valueText } from "./words.js";

const BEFORE = 2; // s before a failure from which it is played

export class Failures {
  constructor(host, section, player, tools) {
    Object.assign(this, { section, player, present: -1 });
    host.classList.add("failures");
    this.list = made("ol", { class: "failures-list", "aria-label": "Failures" });
    this.cards = section.failures.map((story) => this.card(story));
    this.list.append(...this.cards);
    this.scroller = made("div", { class: "failures-scroll" }, this.top(), this.list);
    host.append(this.scroller);
    tools.append(made("span", { class: "failures-count" }, counted(section.failures)));
    onShown(host, () => {
      const card = this.cards[player.failure ?? this.present];
      if (card) bring(this.scroller, card);
    });
    player.onTick(() => this.at());
    player.onFailure((number) => this.choose(number));
  }

  top() {
    const { outcome, root_causes: roots, look_at: moments } = this.section;
    const kind = outcome.status === "success" ? "success" : outcome.status === "killed" ? "open" : "failure";
    return made("div", { class: "failures-top" },
      made("p", { class: `failures-outcome ${kind}` }, outcome.sentence),
      ...(roots.length ? [made("h3", {}, roots.length > 1 ? "Root causes" : "Root cause"), made("ul", { class: "roots" }, ...roots.map((root) => this.root(root)))] : []),
      ...recovery(this.section, this.player),
      ...(moments.length ? [made("h3", {}, "Look at"), made("ul", { class: "moments" }, ...moments.slice(0, 6).map((moment) => this.moment(moment)))] : []),
      made("h3", {}, this.section.failures.length ? "All failures" : "No failures"),
    );
  }

  root(root) {
    const links = root.failures.map((number) =>
      made("button", { class: "number", title: `Failure ${number + 1}`, onclick: () => this.player.selectFailure(number) }, `${number + 1}`),
    );
    return made("li", { class: root.ended_run ? "ended" : "" },
      made("p", {}, made("code", {}, root.cause), root.ended_run ? made("span", { class: "fate ended" }, "cost the goal") : null),
      made("p", { class: "title" }, root.title),
      made("p", { class: "reason account" }, root.account),
      ...root.reasons.map((reason) => made("p", { class: "reason" }, reason)),
      ...root.against.map((reason) => made("p", { class: "reason against" }, `against it: ${reason}`)),
      links.length ? made("p", { class: "numbers" }, links.length > 1 ? "failures " : "failure ", ...links) : null,
    );
  }

  moment({ time, why, failure }) {
    const go = () => {
      if (failure !== null) this.player.selectFailure(failure);
      this.player.pause();
      this.player.seek(time);
    };
    return made("li", {}, made("button", { class: "moment", onclick: go }, made("time", {}, seconds(time)), made("span", {}, why)));
  }

  card(story) {
    const { player } = this;
    const more = made("details", {}, made("summary", {}, "why, and what then"), ...this.fold(story));
    const main = made("button", { class: "story-main", onclick: () => player.selectFailure(story.number) },
      made("span", { class: "story-line" },
        made("span", { class: "number" }, `${story.number + 1}`),
        made("code", {}, story.cause || "failure"),
        made("span", { class: `fate ${story.fate}` }, FATE_WORDS[story.fate] ?? story.fate),
        made("time", {}, seconds(story.time)),
      ),
      made("span", { class: "story-where" }, made("b", {}, story.id), story.item ? ` ${story.item}` : "", story.attempt > 1 ? `, attempt ${story.attempt}` : ""),
      story.message ? made("span", { class: "story-message" }, story.message) : null,
    );
    const play = made("button", {
      class: "icon play", title: `Play from ${BEFORE} s before`, "aria-label": `Play from ${BEFORE} s before failure ${story.number + 1}`,
      onclick: () => {
        player.selectFailure(story.number);
        player.seek(story.time - BEFORE);
        player.play();
      },
    }, "▶");
    return made("li", { class: `story ${story.fate}`, "data-number": story.number }, main, play, more);
  }

  *fold(story) {
    const { player } = this;
    const node = (path) => made("button", { class: "link", title: path, onclick: () => player.selectNode(path) }, path.split("/").slice(-2).join(" › "));
    const at = (time) => made("button", { class: "link", onclick: () => { player.pause(); player.seek(time); } }, seconds(time));
    if (story.sentence) yield made("p", {}, story.sentence);
    if (story.remedy) yield made("p", { class: "remedy" }, `What may help: ${story.remedy}.`);
    if (story.because_of !== null) {
      const other = story.because_of;
      yield made("p", {}, "It follows from ", made("button", { class: "link", onclick: () => player.selectFailure(other) }, `failure ${other + 1}`), ".");
    }
    yield made("h4", {}, "Outcome of the failure");
    const handled = story.handled_by.map((one) => made("li", {}, at(one.time), ` ${one.ran && one.ran !== one.handler ? `${one.ran} for ` : ""}${one.handler} in `, node(one.node), `, attempt ${one.attempt}: ${one.ended}`, one.seconds ? ` after ${one.seconds.toFixed(2)} s` : ""));
    if (handled.length) yield made("ul", {}, ...handled);
    const when = story.fate_at === null ? [] : [" at ", at(story.fate_at)];
    const by = story.fate_by ? [" by ", node(story.fate_by)] : [];
    yield made("p", {}, FATE_PHRASES[story.fate] ?? story.fate, ...when, ...by, ".");
    const end = endOf(this.section.recovery.episodes[story.episode]);
    if (end) yield made("p", {}, `Its episode: ${end}.`);
    if (story.chain.length) {
      yield made("h4", {}, "Path through the tree");
      yield made("ol", { class: "chain" }, ...story.chain.map((link) => made("li", {}, node(link.path), ` ${link.outcome}`)));
    }
    if (story.observed.length) {
      yield made("h4", {}, "Records of the log at this moment");
      yield made("ul", {}, ...story.observed.map((line) => made("li", {}, line)));
    }
    for (const choice of story.choices) yield* chosen(choice, at);
    if (Object.keys(story.evidence).length) {
      yield made("h4", {}, "Evidence");
      yield pairs(story.evidence);
    }
  }

  // The last failure until now stands out, and is brought into the list's sight when it is another.
  at() {
    const { time } = this.player;
    const present = this.section.failures.findLastIndex((story) => story.time <= time + 1e-6);
    if (present === this.present) return;
    this.cards[this.present]?.classList.remove("present");
    this.present = present;
    const card = this.cards[present];
    card?.classList.add("present");
    if (card) bring(this.scroller, card);
  }

  choose(number) {
    const before = this.opened;
    this.opened = null;
    for (const [other, card] of this.cards.entries()) {
      card.classList.toggle("chosen", other === number);
      card.querySelector(".story-main").setAttribute("aria-current", String(other === number));
      // The story that is chosen tells all; one that its reader opened stays so.
      const more = card.querySelector("details");
      if (other === number) {
        if (!more.open || more === before) this.opened = more;
        more.open = true;
      } else if (more === before) {
        more.open = false;
      }
    }
    if (number !== null && this.cards[number]) bring(this.scroller, this.cards[number]);
  }
}

const FATE_PHRASES = {
  cured: "It was cured",
  done_instead: "The mission ran a handler instead of the branch",
  passed_over: "The failure was passed over",
  branched: "The mission took another branch",
  ended: "The failure ended the run",
  open: "The failure is open when the log ends",
};

function counted(failures) {
  if (!failures.length) return "none";
  const cured = failures.filter(({ fate }) => fate === "cured").length;
  return `${failures.length}${cured ? `, ${cured} cured` : ""}`;
}

// What there was to choose from, and why the rest was not taken.
function* chosen(choice, at) {
  const [what] = choice.purpose.split(" by ");  // the path of the node follows
  yield made("h4", { title: choice.purpose }, `Choice of a ${what} for ${choice.object}, `, at(choice.time));
  yield made("p", {}, choice.stages.map(([name, count]) => `${count} ${name}`).join(" → "));
  if (choice.rejections.length) {
    yield made("table", { class: "rejections" }, ...choice.rejections.map(({ name, reason, count }) =>
      made("tr", {}, made("td", {}, count > 1 ? `${count} × ${name}` : name), made("td", {}, valueText(reason))),
    ));
  }
}

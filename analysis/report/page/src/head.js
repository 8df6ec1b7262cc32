// What run it was, in one line; more of it behind the line.

import { icon } from "./icons.js";
import { made } from "./made.js";
import { switchTheme } from "./theme.js";

export class Head {
  constructor(element, run) {
    const { outcome } = run;
    const facts = run.facts.map(([name, value]) => [made("dt", {}, name), made("dd", {}, value)]).flat();
    const about = made("details", { class: "about" }, made("summary", {}, "About"), made("dl", {}, ...facts));
    addEventListener("click", (event) => (about.open &&= about.contains(event.target)));
    about.addEventListener("keydown", (event) => (about.open &&= event.key !== "Escape"));
    element.append(
      made("h1", {}, run.mission, made("small", {}, run.remark)),
      made("span", { class: "outcome", "data-kind": outcome.kind, title: outcome.sentence }, outcome.word),
      made("span", { class: "items" }, outcome.items),
      about,
      made("span", { class: "space" }),
      made("button", { class: "icon", id: "theme", title: "Light or dark", "aria-label": "Light or dark", onclick: switchTheme }, icon("theme")),
      made("button", { class: "icon", id: "ask", title: "Keys (?)", "aria-label": "Keys" }, icon("help")),
    );
    const notes = document.getElementById("notes");
    notes.hidden = run.notes.length === 0;
    notes.append(...run.notes.map((note) => made("p", {}, note)));
  }
}

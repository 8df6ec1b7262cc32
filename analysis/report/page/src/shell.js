// Where the panels stand: two columns of sections that open and close on a large screen, tabs on a small one.

import { made } from "./made.js";
import { recall, remember } from "./theme.js";

const SMALL = matchMedia("(max-width: 760px)");

export class Shell {
  constructor(element, panels, sections, player) {
    this.element = element;
    this.tabs = made("div", { class: "tabs", role: "tablist", "aria-label": "Panels" });
    this.columns = { wide: made("div", { class: "column wide" }), narrow: made("div", { class: "column" }) };
    element.append(this.tabs, this.columns.wide, this.columns.narrow);
    this.panels = panels
      .filter(({ name }) => sections[name])
      .map((panel) => this.frame(panel, sections[panel.name], player));
    const tabbed = this.panels.filter(({ name }) => name !== "stage");
    for (const panel of tabbed) this.tabs.append(panel.tab);
    this.front(tabbed.find(({ name }) => name === "failures") ?? tabbed[0]);
    SMALL.addEventListener("change", () => this.roles());
    this.roles();
  }

  frame({ name, title, wide, Panel }, section, player) {
    const tools = made("div", { class: "tools" });
    const body = made("div", { class: "body", id: `body-${name}` });
    const button = made("button", { class: "fold", "aria-controls": body.id }, made("span", {}, title));
    const head = made("header", {}, made("h2", {}, button), tools);
    const root = made("section", { class: "panel", id: `panel-${name}`, "aria-label": title }, head, body);
    const tab = made("button", { role: "tab", id: `tab-${name}`, "aria-controls": root.id }, title);
    const panel = { name, root, body, button, tab };
    this.columns[wide ? "wide" : "narrow"].append(root);
    button.addEventListener("click", () => this.fold(panel, !body.hidden));
    tab.addEventListener("click", () => this.front(panel));
    tab.addEventListener("keydown", (event) => this.walk(panel, event));
    this.fold(panel, recall(`closed.${name}`) === "yes");
    if (section.empty) body.append(made("p", { class: "empty" }, section.empty));
    else {
      // A panel that cannot be made leaves the others standing.
      try {
        panel.made = new Panel(body, section, player, tools);
      } catch (error) {
        console.error(error);
        body.append(made("p", { class: "empty" }, `This part cannot be shown: ${error.message}`));
      }
    }
    return panel;
  }

  fold(panel, closed) {
    panel.body.hidden = closed;
    panel.root.classList.toggle("closed", closed);
    panel.button.setAttribute("aria-expanded", String(!closed));
    remember(`closed.${panel.name}`, closed ? "yes" : "no");
  }

  // The panel whose tab is in front; the scene has none, it always stands above them.
  front(panel) {
    if (!panel) return;
    for (const other of this.panels) {
      other.root.classList.toggle("front", other === panel);
      other.tab.setAttribute("aria-selected", String(other === panel));
      other.tab.tabIndex = other === panel ? 0 : -1;
    }
    if (SMALL.matches && panel.body.hidden) this.fold(panel, false);
    panel.tab.scrollIntoView({ block: "nearest", inline: "nearest" });
  }

  walk(panel, event) {
    const steps = { ArrowRight: 1, ArrowLeft: -1 };
    if (!(event.key in steps)) return;
    event.preventDefault();
    event.stopPropagation();
    const tabs = [...this.tabs.children];
    const next = tabs[(tabs.indexOf(panel.tab) + steps[event.key] + tabs.length) % tabs.length];
    next.click();
    next.focus();
  }

  // To a reader of the screen, sections are tab panels only where there are tabs.
  roles() {
    for (const { name, root } of this.panels) {
      if (SMALL.matches && name !== "stage") root.setAttribute("role", "tabpanel");
      else root.removeAttribute("role");
    }
  }

  // Brings a panel to the reader's eye.
  show(name) {
    const panel = this.panels.find((other) => other.name === name);
    if (!panel) return;
    if (panel.body.hidden) this.fold(panel, false);
    if (SMALL.matches) this.front(panel);
    else panel.root.scrollIntoView({ block: "nearest", behavior: "smooth" });
  }
}

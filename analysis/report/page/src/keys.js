// The keyboard: what each key does, and the page of help that says so.

import { made } from "./made.js";

export const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];

const KEYS = [
  [["Space"], "play or pause"],
  [["←", "→"], "one tick back or forward"],
  [["Shift ←", "Shift →"], "one second back or forward"],
  [["n", "]"], "next failure"],
  [["p", "["], "previous failure"],
  [["Home", "End"], "first or last tick"],
  [["−", "+"], "slower or faster"],
  [["?"], "this help"],
];

const LEGEND = [
  ["failure", "failure"],
  ["cured", "failure that was cured"],
  ["done", "item done"],
  ["fault", "planted fault"],
];

export class Keys {
  constructor(player) {
    this.player = player;
    this.help = document.getElementById("help");
    this.fill();
    addEventListener("keydown", (event) => this.press(event));
    document.getElementById("ask").addEventListener("click", () => this.ask());
  }

  press(event) {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    if (taken(event)) return;
    const { player } = this;
    const along = (direction) =>
      event.shiftKey ? player.seek(player.time + direction) : player.step(direction);
    const actions = {
      " ": () => player.toggle(),
      ArrowLeft: () => this.still(() => along(-1)),
      ArrowRight: () => this.still(() => along(1)),
      n: () => player.stepFailure(1),
      "]": () => player.stepFailure(1),
      p: () => player.stepFailure(-1),
      "[": () => player.stepFailure(-1),
      Home: () => player.seek(player.begin),
      End: () => player.seek(player.end),
      "+": () => faster(player, 1),
      "=": () => faster(player, 1),
      "-": () => faster(player, -1),
      "?": () => this.ask(),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  still(action) {
    this.player.pause();
    action();
  }

  ask() {
    if (this.help.open) this.help.close();
    else this.help.showModal();
  }

  fill() {
    const rows = KEYS.map(([keys, words]) =>
      made("tr", {}, made("td", {}, ...keys.flatMap((key) => [made("kbd", {}, key), " "])), made("td", {}, words)),
    );
    const legend = LEGEND.map(([kind, words]) =>
      made("span", {}, made("i", { class: `key-${kind}` }), words),
    );
    const close = made("button", { onclick: () => this.help.close() }, "Close");
    this.help.append(
      made("h2", {}, "Keys"),
      made("table", {}, ...rows),
      made("h2", {}, "Marks on the time line"),
      made("div", { class: "legend" }, ...legend),
      made("p", {}, "A click near a failure's mark goes to it and chooses its node. The address of the page names the moment: it can be copied and sent with the file."),
      close,
    );
  }
}

export function faster(player, direction) {
  const index = SPEEDS.indexOf(player.speed) + direction;
  if (SPEEDS[index] !== undefined) player.setSpeed(SPEEDS[index]);
}

// Whether the key belongs to what has the focus: text that is typed, a button that is pressed, a tree walked.
function taken(event) {
  const { target, key } = event;
  if (!(target instanceof Element)) return false;
  if (target.closest("dialog")) return key !== "?";
  if (target.closest("input:not([type=range]), textarea, select, [contenteditable]")) return true;
  if (target.closest("[role=tree], [role=treegrid], [role=listbox], [role=slider]")) {
    return ["ArrowLeft", "ArrowRight", "Home", "End", " "].includes(key);
  }
  return key === " " && target.closest("button, summary, a") !== null;
}

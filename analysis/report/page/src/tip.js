// What is told beside the pointer.

import { made } from "./made.js";

export class Tip {
  constructor(host) {
    this.box = made("div", { class: "tip", role: "status", hidden: true });
    host.append(this.box);
    addEventListener("pointerdown", () => this.hide(), { capture: true });
    addEventListener("scroll", () => this.hide(), { capture: true, passive: true });
  }

  show(content, event) {
    const { box } = this;
    box.replaceChildren(...content);
    box.hidden = false;
    const { width, height } = box.getBoundingClientRect();
    const right = event.clientX + 16 + width < innerWidth - 8;
    const x = right ? event.clientX + 16 : Math.max(event.clientX - 16 - width, 8);
    const y = event.clientY + 16 + height < innerHeight - 8 ? event.clientY + 16 : event.clientY - 16 - height;
    box.style.transform = `translate(${Math.min(x, Math.max(innerWidth - width - 8, 8))}px, ${Math.max(y, 8)}px)`;
  }

  hide() {
    this.box.hidden = true;
  }
}

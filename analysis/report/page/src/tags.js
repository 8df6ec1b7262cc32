// Words that stand at points of the scene.

import { Vector3 } from "three";

import { made } from "./made.js";

export class Tags {
  constructor(host) {
    this.layer = made("div", { class: "tags", "aria-hidden": "true" });
    host.append(this.layer);
    this.pool = [];
  }

  // tags: [[point in the world, text, class], …]
  show(tags, camera, width, height) {
    const point = new Vector3();
    tags.forEach(([at, text, kind], k) => {
      this.pool[k] ??= this.layer.appendChild(made("span"));
      const tag = this.pool[k];
      point.copy(at).project(camera);
      const behind = point.z > 1;
      tag.hidden = behind;
      if (behind) return;
      tag.className = `tag ${kind}`;
      if (tag.textContent !== text) tag.textContent = text;
      const [x, y] = [((point.x + 1) / 2) * width, ((1 - point.y) / 2) * height];
      tag.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -130%)`;
    });
    for (const tag of this.pool.slice(tags.length)) tag.hidden = true;
  }
}

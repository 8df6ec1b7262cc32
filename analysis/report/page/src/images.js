// What the camera saw last, and a strip of all that it saw.

import "./images.css";

import { made } from "./made.js";
import { onShown } from "./scrolling.js";

export class Images {
  constructor(host, section, player, tools) {
    Object.assign(this, { images: section.images, player, place: -2, look: "colour" });
    host.classList.add("images");
    this.host = host;
    this.many = new Set(this.images.map(({ camera }) => camera)).size > 1;
    this.views = {
      colour: made("img", { alt: "What the camera saw" }),
      depth: made("img", { alt: "Depth: bright is near, black is unknown" }),
    };
    this.caption = made("figcaption");
    this.strip = made("div", { class: "images-strip", role: "listbox", "aria-label": "Images", tabindex: "0" });
    this.thumbs = this.images.map((image, place) => this.thumb(image, place));
    this.strip.append(...this.thumbs);
    this.strip.addEventListener("keydown", (event) => this.key(event));
    host.append(
      made("figure", { class: "images-main" }, made("div", { class: "images-views" }, this.views.colour, this.views.depth), this.caption),
      this.strip,
      section.note ? made("p", { class: "images-note" }, section.note) : "",
    );
    this.button = made("button", { class: "chip", "aria-pressed": "false", onclick: () => this.both() }, "Depth");
    tools.append(this.button);
    onShown(host, () => this.centre());
    player.onTick(() => this.at(player.time));
  }

  address(image, look) {
    image.addresses ??= {};
    image.addresses[look] ??= URL.createObjectURL(new Blob([image[look]], { type: "image/webp" }));
    return image.addresses[look];
  }

  thumb(image, place) {
    return made("button", {
      class: "thumb", role: "option", tabindex: "-1", title: `${image.camera}, ${image.time.toFixed(2)} s`,
      "aria-label": `Image at ${image.time.toFixed(2)} s`, onclick: () => this.go(place),
    }, made("img", { src: this.address(image, "colour"), alt: "", loading: "lazy" }), made("time", {}, image.time.toFixed(1)));
  }

  go(place) {
    const image = this.images[place];
    if (!image) return;
    this.player.pause();
    this.player.seek(image.time);
  }

  key(event) {
    const steps = { ArrowRight: 1, ArrowLeft: -1 };
    if (!(event.key in steps)) return;
    event.preventDefault();
    event.stopPropagation();
    this.go(this.place + steps[event.key]);
  }

  both() {
    const depth = this.host.classList.toggle("depth");
    this.button.setAttribute("aria-pressed", String(depth));
  }

  at(time) {
    const place = this.images.findLastIndex((image) => image.time <= time + 1e-6);
    const image = this.images[place];
    if (image) this.say(image, time);
    else this.said = this.caption.textContent = `The first image comes at ${this.images[0].time.toFixed(2)} s.`;
    if (place === this.place) return;
    this.thumbs[this.place]?.setAttribute("aria-selected", "false");
    this.place = place;
    // Before the first image it is shown pale, so that the page keeps its shape.
    this.host.classList.toggle("before", !image);
    for (const [look, view] of Object.entries(this.views)) view.src = this.address(image ?? this.images[0], look);
    this.thumbs[place]?.setAttribute("aria-selected", "true");
    this.centre();
  }

  centre() {
    const thumb = this.thumbs[this.place];
    if (thumb) this.strip.scrollLeft = thumb.offsetLeft + thumb.offsetWidth / 2 - this.strip.clientWidth / 2;
  }

  say(image, time) {
    const ago = time - image.time;
    const when = ago < 0.005 ? "taken now" : `${ago.toFixed(1)} s ago`;
    const fresh = `${image.time} ${when}`;
    if (this.said === fresh) return;
    this.said = fresh;
    const scale = `depth ${image.nearest.toFixed(2)} m (bright) to ${image.farthest.toFixed(2)} m`;
    this.caption.replaceChildren(
      made("span", {}, made("b", {}, `${image.time.toFixed(2)} s`), ` ${when}${this.many ? `, ${image.camera}` : ""}`),
      made("span", { class: "images-scale" }, scale),
      image.findings.length ? made("span", { class: "images-found" }, `found ${image.findings.length}: ${image.findings.join(", ")}`) : "",
    );
  }
}

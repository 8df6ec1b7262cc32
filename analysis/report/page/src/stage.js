// The scene in 3-D: the robot, what it believes (solid) and what is true (outlined), its path, its camera.

import { Box3, Group, Object3D, PCFShadowMap, Raycaster, Scene, Vector2, Vector3, WebGLRenderer } from "three";

import { Believed, Choices, Frustum, Paths, Robot, Truth } from "./actors.js";
import { Lighting } from "./lighting.js";
import { made } from "./made.js";
import { solid } from "./models.js";
import { differencesOf, namesOf, remarksOf } from "./remarks.js";
import "./stage.css";
import { Tags } from "./tags.js";
import { colour, onTheme, recall, remember } from "./theme.js";
import { boundsOf, Views } from "./views.js";

Object3D.DEFAULT_UP.set(0, 0, 1);

const NO_WEBGL =
  "This browser cannot draw in 3-D (WebGL is missing or switched off). The rest of this page works.";
const LAYERS = [
  ["truth", "Truth", "where the bodies truly were, which the robot did not know"],
  ["path", "Path", "the path of the motion that is being made"],
  ["choices", "Candidates", "grasps and placements that the robot considered: green accepted, red refused; click one for its reason"],
  ["camera", "Camera", "what the camera sees"],
  ["names", "Names", "ids of the bodies"],
];
const NEAR_LINE = 0.004; // m from a candidate's outline up to which a click means it
const USUAL = { truth: true, path: true, choices: true, camera: false, names: false };

export class Stage {
  constructor(host, section, player, tools) {
    this.player = player;
    this.view = made("div", { class: "view" });
    host.append(this.view);
    try {
      this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    } catch {
      this.view.append(made("p", { class: "empty" }, NO_WEBGL));
      return;
    }
    this.request = this.request.bind(this);
    this.setUp();
    this.fill(section);
    this.dress(tools, section);
    this.listen();
  }

  setUp() {
    const { renderer } = this;
    renderer.debug.checkShaderErrors = false; // to ask would be to wait for them
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = PCFShadowMap;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.canvas = renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "The scene in 3-D; drag to turn, wheel or two fingers to zoom");
    this.said = made("div", { class: "said" });
    this.view.append(this.canvas);
    this.tags = new Tags(this.view);
    this.view.append(this.said);
    this.scene = new Scene();
    this.lighting = new Lighting(this.scene);
  }

  fill(section) {
    this.fixed = new Group();
    for (const part of section.fixed) {
      const mesh = solid({ ...part, role: "fixed" });
      mesh.castShadow = true;
      mesh.position.fromArray(part.pose);
      mesh.quaternion.fromArray(part.pose, 3);
      mesh.userData.label = part.id;
      this.fixed.add(mesh);
    }
    this.places = placesOf(section.fixed, this.fixed);
    this.robot = new Robot(section);
    this.robot.move(0, 0);
    this.believed = section.objects.map((one) => new Believed(one));
    this.truths = section.truths.map((one) => new Truth(one, this.believed, colour("truth")));
    this.paths = new Paths(section.plans, colour("running"));
    this.choices = new Choices(section.choices, colour("success"), colour("failure"));
    this.frusta = section.cameras.map((one) => new Frustum(one, colour("muted")));
    this.layers = { truth: new Group(), path: this.paths.group, choices: this.choices.group, camera: new Group() };
    for (const one of this.truths) this.layers.truth.add(one.group);
    for (const one of this.frusta) this.layers.camera.add(one.group);
    for (const one of this.believed) this.scene.add(one.group);
    this.scene.add(this.fixed, this.robot.group, ...Object.values(this.layers));
    const { robot, frusta } = this;
    const bounds = boundsOf(robot, section.objects, this.fixed);
    this.views = new Views(this.canvas, { robot, frusta, bounds }, this.request);
  }

  dress(tools, section) {
    this.shown = { ...USUAL };
    const has = {
      truth: section.truths.length, path: section.plans.length, choices: section.choices.length,
      camera: section.cameras.length, names: section.objects.length,
    };
    for (const [name, label, title] of LAYERS) {
      if (!has[name]) continue;
      const remembered = recall(`layer.${name}`);
      const button = made("button", {
        class: `chip ${name}`, title: `${label}: ${title}`,
        onclick: () => {
          this.show(name, !this.shown[name], button);
          remember(`layer.${name}`, this.shown[name] ? "yes" : "no");
        },
      }, label);
      tools.append(button);
      this.show(name, remembered === null ? USUAL[name] : remembered === "yes", button);
    }
    tools.append(this.views.chooser);
  }

  show(name, shown, button) {
    this.shown[name] = shown;
    button.setAttribute("aria-pressed", String(shown));
    if (this.layers[name]) this.layers[name].visible = shown;
    this.moved = true;
    this.request();
  }

  listen() {
    const { canvas } = this;
    const again = () => {
      this.moved = true;
      this.request();
    };
    this.player.onTime(again);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", again);
    onTheme(() => {
      this.lighting.theme();
      this.request();
    });
    new ResizeObserver(() => this.resize()).observe(this.view);
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
    canvas.addEventListener("pointerup", (event) => {
      if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5) this.pick(event);
      pressed = null;
    });
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.view;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.views.resize(width, height);
    this.request();
  }

  // Drawn only when something is another, at most once a frame.
  request() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      if (this.view.clientWidth && this.view.clientHeight) this.draw();
    });
  }

  draw() {
    if (this.moved) this.move();
    this.renderer.render(this.scene, this.views.camera);
    const tags = this.shown.truth ? differencesOf(this.truths) : [];
    tags.push(...namesOf(this.believed, this.truths, this.places, this.picked, this.shown.names));
    this.tags.show(tags, this.views.camera, this.view.clientWidth, this.view.clientHeight);
  }

  move() {
    this.moved = false;
    const { time, tick, times } = this.player;
    const next = times[tick + 1];
    const share = next === undefined ? 0 : Math.min(Math.max((time - times[tick]) / (next - times[tick]), 0), 1);
    const before = this.robot.tcp.clone();
    for (const one of [this.robot, ...this.believed, ...this.truths, ...this.frusta]) one.move(tick, share);
    for (const one of [this.paths, this.choices]) one.move(time);
    this.views.follow(this.robot.tcp.clone().sub(before));
    const remarks = remarksOf(this.believed, this.shown.truth ? this.truths : [], this.shown.choices ? this.choices.shown : null);
    const words = JSON.stringify(remarks);
    if (words !== this.words) this.said.replaceChildren(...remarks.map(([kind, text]) => made("span", { class: kind }, text)));
    this.words = words;
  }

  pick(event) {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.views.camera);
    const roots = [this.fixed, this.robot.group, ...this.believed.map((one) => one.group)];
    if (this.shown.truth) roots.push(...this.truths.map((one) => one.ghost.body));
    if (this.shown.choices) roots.push(this.choices.group);
    ray.params.Line.threshold = NEAR_LINE;
    const hit = ray.intersectObjects(roots, true).find(({ object }) => isSeen(object));
    this.picked = null;
    if (hit) {
      const { object, truth } = hit.object.parent.userData;
      const label = hit.object.isLineSegments ? this.choices.verdict(hit.index) : hit.object.userData.label;
      this.picked = object || truth ? { object, truth } : { label, at: hit.point };
    }
    this.request();
  }
}

// Each fixture and bin by its id, with the point above its middle.
function placesOf(parts, fixed) {
  const boxes = new Map();
  parts.forEach(({ id }, k) => {
    const own = new Box3().setFromObject(fixed.children[k]);
    boxes.set(id, boxes.has(id) ? boxes.get(id).union(own) : own);
  });
  return [...boxes].map(([id, box]) => [id, box.getCenter(new Vector3()).setZ(box.max.z)]);
}

function isSeen(object) {
  for (let one = object; one; one = one.parent) if (!one.visible) return false;
  return true;
}

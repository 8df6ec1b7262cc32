// The scene in 3-D: the robot, what it believes (solid) and what is true (outlined), its path, its camera.

import {
  AmbientLight, Box3, Color, DirectionalLight, Group, GridHelper, HemisphereLight, Object3D, PCFShadowMap, PerspectiveCamera,
  Raycaster, Scene, Sphere, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { Believed, Choices, Frustum, Paths, Robot, TOLERANCE, Truth } from "./actors.js";
import { made } from "./made.js";
import { solid } from "./models.js";
import "./stage.css";
import { Tags } from "./tags.js";
import { colour, onTheme, recall, remember } from "./theme.js";

Object3D.DEFAULT_UP.set(0, 0, 1);

const LAYERS = [
  ["truth", "Truth", "where the bodies truly were, which the robot did not know"],
  ["path", "Path", "the path of the motion that is being made"],
  ["choices", "Candidates", "grasps and placements that were thought of: green taken, red refused"],
  ["camera", "Camera", "what the camera sees"],
  ["names", "Names", "ids of the bodies"],
];
const USUAL = { truth: true, path: true, choices: true, camera: false, names: false };
const VIEWS = {
  Overview: [1.3, -0.62, 0.78],
  Front: [1, 0, 0.18],
  Left: [0, 1, 0.18],
  Right: [0, -1, 0.18],
  Top: [0.001, 0, 1],
};

export class Stage {
  constructor(host, section, player, tools) {
    this.host = host;
    this.player = player;
    this.view = made("div", { class: "view" });
    host.append(this.view);
    try {
      this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    } catch {
      this.view.append(
        made("p", { class: "empty" }, "This browser draws no 3-D (WebGL is missing or switched off). All else on this page works without it."),
      );
      return;
    }
    this.build(section);
    this.dress(tools, section);
    this.listen();
  }

  build(section) {
    const { renderer } = this;
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = PCFShadowMap;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const canvas = renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "The scene in 3-D; drag to turn, wheel or two fingers to zoom");
    this.view.append(canvas);
    this.tags = new Tags(this.view);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(38, 1, 0.02, 30);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.request());
    this.controls.addEventListener("start", () => this.follow(false));
    this.controls.maxPolarAngle = Math.PI * 0.55;
    this.controls.minDistance = 0.12;
    this.controls.maxDistance = 8;

    this.lights();
    this.fixed = new Group();
    for (const part of section.fixed) {
      const mesh = solid({ ...part, role: "fixed" });
      mesh.castShadow = true;
      mesh.position.fromArray(part.pose);
      mesh.quaternion.fromArray(part.pose, 3);
      mesh.userData.label = part.id;
      this.fixed.add(mesh);
    }
    this.places = this.namePlaces(section);
    this.robot = new Robot(section);
    this.believed = section.objects.map((one) => new Believed(one));
    const truthColour = colour("truth") || "#d6008f";
    this.truths = section.truths.map((one) => new Truth(one, this.believed, truthColour));
    this.paths = new Paths(section.plans, colour("running"));
    this.choices = new Choices(section.choices, colour("success"), colour("failure"));
    this.frusta = section.cameras.map((one) => new Frustum(one, colour("muted")));
    this.layers = { truth: new Group(), path: this.paths.group, choices: this.choices.group, camera: new Group() };
    for (const one of this.truths) this.layers.truth.add(one.group);
    for (const one of this.frusta) this.layers.camera.add(one.group);
    for (const one of this.believed) this.scene.add(one.group);
    this.scene.add(this.fixed, this.robot.group, ...Object.values(this.layers));
    this.bounds = this.whole(section);
  }

  lights() {
    this.sky = new HemisphereLight(0xffffff, 0x8a8f99, 1.6);
    this.sun = new DirectionalLight(0xffffff, 2.2);
    this.sun.position.set(0.9, -0.8, 2.2);
    this.sun.target.position.set(0.4, 0, 0);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    Object.assign(this.sun.shadow.camera, { left: -1.3, right: 1.3, top: 1.3, bottom: -1.3, near: 0.2, far: 5 });
    this.sun.shadow.bias = -0.0004;
    this.sun.shadow.normalBias = 0.006;
    this.sun.shadow.radius = 3;
    this.grid = new GridHelper(6, 30);
    this.grid.rotation.x = Math.PI / 2;
    this.grid.position.z = -0.041;
    this.grid.material.transparent = true;
    this.scene.add(this.sky, new AmbientLight(0xffffff, 0.25), this.sun, this.sun.target, this.grid);
  }

  // Above the middle of each fixture and bin.
  namePlaces(section) {
    const boxes = new Map();
    section.fixed.forEach(({ id }, k) => {
      const own = new Box3().setFromObject(this.fixed.children[k]);
      boxes.set(id, boxes.has(id) ? boxes.get(id).union(own) : own);
    });
    return [...boxes].map(([id, box]) => [id, box.getCenter(new Vector3()).setZ(box.max.z)]);
  }

  // What an overview is to show: the robot, all that was ever believed, and the fixtures but for the table.
  whole(section) {
    this.robot.move(0, 0);
    const box = new Box3();
    const point = new Vector3();
    for (const frame of this.robot.frames) box.expandByPoint(frame.position);
    for (const one of section.objects) box.expandByPoint(point.fromArray(one.track.p));
    for (const part of this.fixed.children) {
      const own = new Box3().setFromObject(part);
      if (own.getSize(point).x < 0.7) box.union(own);
    }
    if (box.isEmpty()) box.setFromObject(this.fixed);
    return box.isEmpty() ? new Sphere(new Vector3(0.4, 0, 0.2), 0.8) : box.getBoundingSphere(new Sphere());
  }

  dress(tools, section) {
    const remembered = JSON.parse(recall("layers") ?? "{}");
    this.shown = { ...USUAL, ...remembered };
    const has = {
      truth: section.truths.length, path: section.plans.length, choices: section.choices.length,
      camera: section.cameras.length, names: section.objects.length,
    };
    for (const [name, label, title] of LAYERS) {
      if (!has[name]) continue;
      const button = made("button", {
        class: `chip ${name}`, title: `${label}: ${title}`, "aria-pressed": String(this.shown[name]),
        onclick: () => this.show(name, !this.shown[name], button),
      }, label);
      tools.append(button);
      this.show(name, this.shown[name], button);
    }
    const views = Object.keys(VIEWS).concat(section.cameras.map(({ name }) => `Camera ${name}`), section.tool ? ["Follow the hand"] : []);
    this.chooser = made("select", { "aria-label": "View", title: "View", onchange: () => this.look(this.chooser.value) },
      ...views.map((name) => made("option", { value: name }, name)));
    tools.append(this.chooser);
    this.said = made("div", { class: "said", "aria-live": "off" });
    this.view.append(this.said);
  }

  show(name, shown, button) {
    this.shown[name] = shown;
    button.setAttribute("aria-pressed", String(shown));
    if (this.layers[name]) this.layers[name].visible = shown;
    remember("layers", JSON.stringify(this.shown));
    this.moved = true;
    this.request();
  }

  look(name) {
    const following = name === "Follow the hand";
    const frustum = this.frusta.find((one) => name === `Camera ${one.camera.name}`);
    this.widen();
    for (const one of this.frusta) one.body.visible = one !== frustum;
    if (frustum) this.lookThrough(frustum);
    else if (following) {
      this.camera.position.copy(this.robot.tcp).add(new Vector3(0.42, -0.36, 0.22));
      this.controls.target.copy(this.robot.tcp);
    } else {
      const { radius } = this.bounds;
      const center = this.bounds.center.clone();
      // What there is to see lies lower than the arm's elbow.
      center.z -= 0.22 * radius;
      const narrow = Math.min(this.camera.aspect, 1);
      const away = (radius * 0.8) / Math.sin((this.camera.fov * Math.PI) / 360) / Math.min(narrow * 1.15, 1);
      this.controls.target.copy(center);
      this.camera.position.fromArray(VIEWS[name]).setLength(away).add(center);
    }
    this.controls.update();
    this.view.classList.toggle("following", following);
    this.following = following;
    this.request();
  }

  // From the camera's own place, with its field of view and a little around it.
  lookThrough({ group, camera }) {
    const ahead = new Vector3(0, 0, 1).applyQuaternion(group.quaternion);
    const up = new Vector3(0, -1, 0).applyQuaternion(group.quaternion).setZ(0);
    this.camera.position.copy(group.position);
    // Straight down there is no up but the image's: the view comes from a hair below it.
    if (Math.abs(ahead.z) > 0.99) this.camera.position.addScaledVector(up, -0.003);
    this.controls.target.copy(group.position).addScaledVector(ahead, Math.max(group.position.z, 0.3));
    this.camera.fov = ((2 * Math.atan(camera.height / 2 / camera.focal[1])) / Math.PI) * 180 * 1.08;
    this.camera.updateProjectionMatrix();
  }

  follow(on) {
    if (!on && this.following) {
      this.following = false;
      if (this.chooser) this.chooser.selectedIndex = 0;
    }
  }

  listen() {
    const canvas = this.renderer.domElement;
    this.moved = true;
    this.player.onTime(() => { this.moved = true; this.request(); });
    new ResizeObserver(() => this.resize()).observe(this.view);
    onTheme(() => this.theme());
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
    canvas.addEventListener("pointerup", (event) => {
      if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5) this.pick(event);
      pressed = null;
    });
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => { this.moved = true; this.request(); });
  }

  theme() {
    const dark = document.documentElement.dataset.theme === "dark";
    this.scene.background = new Color(colour("stage") || colour("paper"));
    this.sky.intensity = dark ? 0.75 : 1.6;
    this.sun.intensity = dark ? 1.5 : 2.2;
    const line = new Color(colour("rim"));
    this.scene.remove(this.grid);
    this.grid.dispose();
    this.grid = new GridHelper(6, 30, line, line);
    this.grid.rotation.x = Math.PI / 2;
    this.grid.position.z = -0.041;
    this.grid.material.transparent = true;
    this.grid.material.opacity = dark ? 0.35 : 0.5;
    this.scene.add(this.grid);
    this.request();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.view;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.sized) this.look("Overview");
    this.sized = true;
    this.request();
  }

  // A narrow view is to show as much from side to side as a wide one.
  widen() {
    this.camera.fov = this.camera.aspect < 1.3 ? Math.min(38 * (1.3 / this.camera.aspect), 62) : 38;
    this.camera.updateProjectionMatrix();
  }

  request() {
    if (this.asked || !this.renderer) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      if (this.view.clientWidth && this.view.clientHeight) this.draw();
    });
  }

  draw() {
    if (this.moved) this.move();
    this.renderer.render(this.scene, this.camera);
    this.label();
  }

  move() {
    this.moved = false;
    const { time, tick, times } = this.player;
    const next = times[tick + 1];
    const share = next === undefined ? 0 : Math.min(Math.max((time - times[tick]) / (next - times[tick]), 0), 1);
    const before = this.robot.tcp.clone();
    this.robot.move(tick, share);
    for (const one of this.believed) one.move(tick, share);
    for (const one of this.truths) one.move(tick, share);
    for (const one of this.frusta) one.move(tick, share);
    this.paths.move(time);
    this.choices.move(time);
    if (this.following) {
      const step = this.robot.tcp.clone().sub(before);
      this.camera.position.add(step);
      this.controls.target.add(step);
      this.controls.update();
    }
    this.say();
  }

  // Belief against truth in words, the largest difference first.
  say() {
    const held = this.believed.filter((one) => one.group.visible && one.isHeld).map(({ id }) => `holds ${id}`);
    const parts = held.map((words) => made("span", { class: "held" }, words));
    if (this.shown.truth) {
      const apart = this.truths
        .filter((one) => one.state === "gone" || (one.state === "both" && one.distance > TOLERANCE))
        .sort((a, b) => (b.distance || 1e9) - (a.distance || 1e9));
      for (const one of apart.slice(0, 3)) {
        const words = one.state === "gone" ? `${one.partner.id} is not there` : `${one.partner.id} is ${millimetres(one.distance)} off`;
        parts.push(made("span", { class: "apart" }, words));
      }
      if (apart.length > 3) parts.push(made("span", { class: "apart" }, `and ${apart.length - 3} more`));
      const unknown = this.truths.filter((one) => one.state === "unknown").length;
      if (unknown) parts.push(made("span", { class: "apart" }, `${unknown} not known to the robot`));
    }
    this.said?.replaceChildren(...parts);
  }

  label() {
    const tags = [];
    if (this.shown.truth) {
      for (const one of this.truths) {
        if (one.state === "both" && one.distance > TOLERANCE) {
          tags.push([one.partner.group.position.clone().lerp(one.ghost.position, 0.5), millimetres(one.distance), "apart"]);
        } else if (one.state === "gone") tags.push([one.partner.group.position, "not there", "apart"]);
      }
    }
    for (const one of this.believed) {
      if (one.group.visible && (this.shown.names || one === this.picked?.object)) {
        tags.push([one.group.position.clone().add(new Vector3(0, 0, 0.045)), this.nameOf(one), "name"]);
      }
    }
    if (this.shown.names) for (const [id, at] of this.places) tags.push([at, id, "name"]);
    for (const one of this.truths) {
      if (one === this.picked?.truth && one.ghost.visible) {
        tags.push([one.ghost.position.clone().add(new Vector3(0, 0, 0.045)), `${one.id} (${one.kind}), truly`, "name"]);
      }
    }
    if (this.picked?.label) tags.push([this.picked.at, this.picked.label, "name"]);
    this.tags.show(tags, this.camera, this.view.clientWidth, this.view.clientHeight);
  }

  nameOf(one) {
    if (one !== this.picked?.object) return one.id;
    const { kind, place } = one.look;
    return `${one.id}: ${kind}${one.isHeld ? ", in the hand" : place ? `, ${place}` : ""}`;
  }

  pick(event) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.camera);
    const roots = [this.fixed, this.robot.group, ...this.believed.map((one) => one.group)];
    if (this.shown.truth) roots.push(...this.truths.map((one) => one.ghost.body));
    const hit = ray.intersectObjects(roots, true).find(({ object }) => seen(object));
    this.picked = null;
    if (hit) {
      const data = hit.object.parent.userData;
      if (data.object) this.picked = { object: data.object };
      else if (data.truth) this.picked = { truth: data.truth };
      else this.picked = { label: hit.object.userData.label, at: hit.point };
    }
    this.request();
  }
}

function seen(object) {
  for (let one = object; one; one = one.parent) if (!one.visible) return false;
  return true;
}

function millimetres(metres) {
  return metres >= 0.1 ? `${(metres * 100).toFixed(0)} cm` : `${(metres * 1000).toFixed(0)} mm`;
}

// From where the scene is looked at: from all around, through a camera, or along with the hand.

import { Box3, PerspectiveCamera, Sphere, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import { made } from "./made.js";

const AROUND = {
  Overview: [1.3, -0.62, 0.78],
  Front: [1, 0, 0.18],
  Left: [0, 1, 0.18],
  Right: [0, -1, 0.18],
  Top: [0.001, 0, 1],
};
const HAND = "Follow the hand";
const OWN = "Your own view";
const BESIDE = new Vector3(0.42, -0.36, 0.22); // from the hand to who follows it, m
const ANGLE = 38; // of view, degrees from top to bottom
const WIDE = 1.3; // width by height below which the angle grows

export class Views {
  // `changed` is called whenever the scene is to be drawn anew.
  constructor(canvas, { robot, frusta, bounds }, changed) {
    Object.assign(this, { robot, frusta, bounds });
    this.camera = new PerspectiveCamera(ANGLE, 1, 0.02, 30);
    this.controls = new OrbitControls(this.camera, canvas);
    Object.assign(this.controls, { maxPolarAngle: Math.PI * 0.55, minDistance: 0.12, maxDistance: 8 });
    this.controls.addEventListener("change", changed);
    this.controls.addEventListener("start", () => {
      if (!this.following) this.chooser.value = OWN;
    });
    const names = [...Object.keys(AROUND), ...frusta.map(({ camera }) => through(camera)), ...(robot.tool ? [HAND] : [])];
    this.chooser = made(
      "select",
      { "aria-label": "View", title: "View", onchange: () => this.look(this.chooser.value) },
      ...names.map((name) => made("option", { value: name }, name)),
      made("option", { value: OWN, hidden: true }, OWN),
    );
  }

  resize(width, height) {
    const first = !this.sized;
    this.sized = true;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (first) this.look("Overview");
  }

  look(name) {
    const frustum = this.frusta.find(({ camera }) => name === through(camera));
    this.following = name === HAND;
    for (const one of this.frusta) one.body.visible = one !== frustum;
    const { aspect } = this.camera;
    // A narrow view is to show as much from side to side as a wide one.
    this.camera.fov = aspect < WIDE ? Math.min((ANGLE * WIDE) / aspect, 62) : ANGLE;
    if (frustum) this.lookThrough(frustum);
    else if (this.following) {
      this.camera.position.copy(this.robot.tcp).add(BESIDE);
      this.controls.target.copy(this.robot.tcp);
    } else this.lookFrom(AROUND[name]);
    this.camera.updateProjectionMatrix();
    this.controls.update();
  }

  lookFrom(direction) {
    const { center, radius } = this.bounds;
    const away = (radius * 0.8) / Math.sin((this.camera.fov * Math.PI) / 360) / Math.min(this.camera.aspect * 1.15, 1);
    // What there is to see lies lower than the arm's elbow.
    this.controls.target.copy(center).add(new Vector3(0, 0, -0.22 * radius));
    this.camera.position.fromArray(direction).setLength(away).add(this.controls.target);
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
  }

  // The hand has gone by `step`.
  follow(step) {
    if (!this.following) return;
    this.camera.position.add(step);
    this.controls.target.add(step);
    this.controls.update();
  }
}

// What an overview is to show: the robot, all that was ever believed, and the fixtures but for the table.
export function boundsOf(robot, objects, fixed) {
  const box = new Box3();
  const point = new Vector3();
  for (const frame of robot.frames) box.expandByPoint(frame.position);
  for (const one of objects) box.expandByPoint(point.fromArray(one.track.p));
  for (const part of fixed.children) {
    const own = new Box3().setFromObject(part);
    if (own.getSize(point).x < 0.7) box.union(own);
  }
  if (box.isEmpty()) box.setFromObject(fixed);
  return box.isEmpty() ? new Sphere(new Vector3(0.4, 0, 0.2), 0.8) : box.getBoundingSphere(new Sphere());
}

function through(camera) {
  return `Camera ${camera.name}`;
}
